//! Overlap of boxes in the image.

/// A box in pixels with its corner at `(x, y)`; its area is `width · height`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rectangle {
    /// Left edge.
    pub x: f64,
    /// Upper edge.
    pub y: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
}

impl Rectangle {
    /// Area in square pixels; zero for a box of no extent.
    pub fn area(&self) -> f64 {
        self.width.max(0.0) * self.height.max(0.0)
    }

    /// Intersection over union, in `[0, 1]`; zero when both are empty or a coordinate is not a number.
    pub fn iou(&self, other: &Self) -> f64 {
        let all = [self.x, self.y, self.width, self.height, other.x, other.y, other.width, other.height];
        if all.iter().any(|v| v.is_nan()) {
            return 0.0;
        }
        let span = |a: f64, m: f64, b: f64, n: f64| (a + m).min(b + n) - a.max(b);
        let width = span(self.x, self.width, other.x, other.width);
        let height = span(self.y, self.height, other.y, other.height);
        let common = Self { width, height, ..*self }.area();
        let union = self.area() + other.area() - common;
        if union > 0.0 { common / union } else { 0.0 }
    }

    /// Distance of the centres in pixels.
    pub fn centre_error(&self, other: &Self) -> f64 {
        let dx = self.x + 0.5 * self.width - other.x - 0.5 * other.width;
        let dy = self.y + 0.5 * self.height - other.y - 0.5 * other.height;
        (dx * dx + dy * dy).sqrt()
    }
}

/// Share of the overlaps above `threshold`; `None` without overlaps. A frame without a result counts as 0.
pub fn success_rate(overlaps: &[f64], threshold: f64) -> Option<f64> {
    let hits = overlaps.iter().filter(|o| **o > threshold).count();
    (!overlaps.is_empty()).then(|| hits as f64 / overlaps.len() as f64)
}

/// Success AUC of the OTB benchmark (Y. Wu, J. Lim, M.-H. Yang, "Object tracking benchmark", 2015): mean of
/// [`success_rate`] over the 21 thresholds 0, 0.05 … 1. A perfect result has 20/21, for nothing exceeds 1.
pub fn success_auc(overlaps: &[f64]) -> Option<f64> {
    let rates = (0..=20).map(|k| success_rate(overlaps, f64::from(k) / 20.0));
    rates.sum::<Option<f64>>().map(|sum| sum / 21.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Rectangle {
        Rectangle { x, y, width: side, height: side }
    }

    #[test]
    fn overlap_is_a_share_of_the_union() {
        let a = square(10.0, 10.0, 10.0);
        assert_eq!(a.iou(&a), 1.0);
        assert_eq!(a.iou(&square(15.0, 10.0, 10.0)), 50.0 / 150.0);
        assert_eq!(square(15.0, 10.0, 10.0).iou(&a), 50.0 / 150.0);
        assert_eq!(a.iou(&square(12.0, 12.0, 5.0)), 0.25);
        for apart in [
            square(20.0, 10.0, 10.0),
            square(100.0, 100.0, 1.0),
            square(f64::NAN, 12.0, 5.0),
            square(12.0, 12.0, f64::NAN),
            square(15.0, 15.0, -3.0),
        ] {
            assert_eq!(a.iou(&apart), 0.0, "{apart:?}");
        }
        assert_eq!(Rectangle::default().iou(&Rectangle::default()), 0.0);
        assert_eq!(a.centre_error(&square(13.0, 14.0, 10.0)), 5.0);
    }

    #[test]
    fn success_follows_the_benchmark() {
        assert_eq!(success_auc(&[1.0, 1.0]), Some(20.0 / 21.0));
        assert_eq!(success_auc(&[0.0]), Some(0.0));
        // 0.5 exceeds 0, 0.05 … 0.45: ten thresholds.
        assert!((success_auc(&[0.5, 1.0]).expect("overlaps") - 15.0 / 21.0).abs() < 1e-15);
        assert_eq!((success_rate(&[0.5, 0.51], 0.5), success_auc(&[])), (Some(0.5), None));
    }
}
