//! Noise of a picture, estimated from the picture itself.

use image::GrayImage;

/// Distance of the places that are looked at, pixels: some 750 of them in a picture of 640 × 480.
const STRIDE: usize = 20;

/// Standard deviation of the sensor noise in grey levels, after Immerkær ("Fast noise variance estimation", 1996): a
/// mask that answers neither to planes nor to straight edges is applied on a grid, and the median of its absolute answers
/// leaves texture aside. Zero for pictures too small to tell.
pub fn noise_deviation(image: &GrayImage, scratch: &mut Vec<u16>) -> f64 {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.as_raw();
    scratch.clear();
    for y in (1..height.saturating_sub(1)).step_by(STRIDE) {
        for x in (1..width.saturating_sub(1)).step_by(STRIDE) {
            let at = |dy: usize, dx: usize| i32::from(pixels[(y + dy - 1) * width + x + dx - 1]);
            let corners = at(0, 0) + at(0, 2) + at(2, 0) + at(2, 2);
            let sides = at(0, 1) + at(1, 0) + at(1, 2) + at(2, 1);
            scratch.push((corners - 2 * sides + 4 * at(1, 1)).unsigned_abs() as u16);
        }
    }
    if scratch.len() < 16 {
        return 0.0;
    }
    let middle = scratch.len() / 2;
    let (_, median, _) = scratch.select_nth_unstable(middle);
    // The mask's squared norm is 36; 0.6745 is the median of |N(0, 1)|.
    f64::from(*median) / (6.0 * 0.6745)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use vt_core::random::{Random, Stream};

    #[test]
    fn noise_is_found_on_structure_and_not_made_up() {
        let mut scratch = vec![];
        let plain = |x: u32, y: u32| if x < 200 { 60.0 } else { 120.0 + 0.2 * f64::from(y) };
        for deviation in [0.0, 3.0, 8.0, 20.0] {
            let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
            let image = GrayImage::from_fn(320, 240, |x, y| {
                Luma([(plain(x, y) + deviation * random.normal()).round().clamp(0.0, 255.0) as u8])
            });
            let found = noise_deviation(&image, &mut scratch);
            assert!((found - deviation).abs() < 0.15 * deviation + 0.5, "{found} instead of {deviation}");
        }
        assert_eq!(noise_deviation(&GrayImage::new(2, 9), &mut scratch), 0.0);
        assert_eq!(noise_deviation(&GrayImage::new(0, 0), &mut scratch), 0.0);
    }
}
