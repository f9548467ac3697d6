//! Pixels by how well their colour fits a histogram.

use super::Histogram;
use crate::plane::Plane;

/// A byte for every bin: the weights scaled so that the greatest is 255.
pub fn scaled_table(histogram: &Histogram, table: &mut Vec<u8>) {
    let greatest = histogram.weights().iter().fold(0.0f32, |a, &b| a.max(b));
    let scale = if greatest > 0.0 { 255.0 / greatest } else { 0.0 };
    table.clear();
    table.extend(histogram.weights().iter().map(|w| (w * scale).round() as u8));
}

/// A byte for every bin: 255 times the probability `p / (p + b)` that a pixel with this colour is of the target, when target
/// and background, both normalised, are as likely beforehand. Bins that neither has seen get `prior`.
pub fn likelihood_ratio_table(target: &Histogram, background: &Histogram, prior: u8, table: &mut Vec<u8>) {
    let scale = |h: &Histogram| if h.total() > 0.0 { 1.0 / h.total() } else { 0.0 };
    let (of_target, of_background) = (scale(target), scale(background));
    table.clear();
    table.extend(target.weights().iter().zip(background.weights()).map(|(p, b)| {
        let (p, b) = (p * of_target, b * of_background);
        if p + b > 0.0 { (255.0 * p / (p + b)).round() as u8 } else { prior }
    }));
}

/// The byte of each pixel's bin; 0 for pixels without one.
pub fn back_project(bins: &Plane<u16>, table: &[u8], out: &mut Plane<u8>) {
    let out = out.reshape(bins.region());
    for (byte, &bin) in out.iter_mut().zip(bins.values()) {
        *byte = table.get(usize::from(bin)).copied().unwrap_or(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::frame::Roi;

    fn histogram(weights: &[f32]) -> Histogram {
        let mut h = Histogram::new(weights.len());
        h.weights_mut().copy_from_slice(weights);
        h
    }

    #[test]
    fn pixels_get_the_byte_of_their_bin() {
        let mut table = vec![];
        scaled_table(&histogram(&[1.0, 4.0, 0.0]), &mut table);
        assert_eq!(table, [64, 255, 0]);
        let mut bins = Plane::default();
        bins.reshape(Roi { x: 5, y: 1, width: 2, height: 2 }).copy_from_slice(&[1, 0, 3, 2]);
        let mut out = Plane::default();
        back_project(&bins, &table, &mut out);
        assert_eq!((out.region(), out.values()), (bins.region(), &[255, 64, 0, 0][..]));
        scaled_table(&Histogram::new(2), &mut table);
        assert_eq!(table, [0, 0]);
    }

    #[test]
    fn ratios_are_posterior_probabilities() {
        let mut table = vec![];
        let (target, background) = (histogram(&[30.0, 10.0, 0.0, 0.0]), histogram(&[0.0, 0.25, 0.75, 0.0]));
        likelihood_ratio_table(&target, &background, 7, &mut table);
        assert_eq!(table, [255, 128, 0, 7]);
        likelihood_ratio_table(&target, &Histogram::new(4), 7, &mut table);
        assert_eq!(table, [255, 255, 7, 7]);
    }
}
