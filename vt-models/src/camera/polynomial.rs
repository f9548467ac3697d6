//! Where a polynomial stops being positive.

/// First place in `(0, high]` at which the polynomial with these coefficients (constant first, positive there) is no
/// longer positive; `None` where it stays positive.
pub(super) fn first_nonpositive(coefficients: &[f64], high: f64) -> Option<f64> {
    let mut low = 0.0;
    for stop in stops(coefficients, high) {
        if evaluate(coefficients, stop) <= 0.0 {
            return Some(bisect(coefficients, low, stop).0);
        }
        low = stop;
    }
    None
}

/// Value at `x` (Horner's scheme).
pub(super) fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Places in `(0, high]`, in order and ending with `high`, between which the polynomial is monotone: the roots of its
/// derivative, found between the stops of the derivative in turn.
fn stops(coefficients: &[f64], high: f64) -> Vec<f64> {
    let derivative: Vec<f64> = coefficients.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c).collect();
    let mut roots = Vec::new();
    if derivative.len() > 1 {
        let mut low = 0.0;
        for stop in stops(&derivative, high) {
            if (evaluate(&derivative, low) > 0.0) != (evaluate(&derivative, stop) > 0.0) {
                roots.push(bisect(&derivative, low, stop).1);
            }
            low = stop;
        }
    }
    roots.retain(|r| *r < high);
    roots.push(high);
    roots
}

/// Neighbouring numbers between which the sign changes.
fn bisect(coefficients: &[f64], mut low: f64, mut high: f64) -> (f64, f64) {
    let positive = evaluate(coefficients, low) > 0.0;
    for _ in 0..200 {
        let middle = f64::midpoint(low, high);
        if (evaluate(coefficients, middle) > 0.0) == positive { low = middle } else { high = middle }
    }
    (low, high)
}
