//! A flat coloured figure before a textured background.

use std::sync::Arc;

use image::{GrayImage, Rgb, RgbImage};
use nalgebra::{DefaultAllocator, Point2};
use vt_core::belief::Gaussian;
use vt_core::evidence::{Evidence, Processing};
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Tangent};
use vt_core::math;
use vt_core::measurement::Modality;
use vt_core::time::Timestamp;
use vt_models::outline::Outline;

/// The only sensor.
pub const SENSOR: SensorId = SensorId(0);

/// Size of the pictures.
const SIZE: (u32, u32) = (200, 160);

/// A rounded figure without symmetry, some 70 pixels wide, about the origin.
pub fn figure() -> Outline {
    let control =
        [[-34, -8], [-20, -30], [4, -20], [30, -28], [36, 0], [16, 12], [20, 30], [-10, 26], [-30, 22]];
    Outline::spline(&control.map(|[x, y]| Point2::new(f64::from(x), f64::from(y)))).unwrap().centred()
}

/// Colour of a place of the figure: smooth, and different everywhere.
fn inside(p: Point2<f64>) -> [f64; 3] {
    let wave = |a: f64, b: f64, c: f64| 150.0 + 70.0 * math::sin(a * p.x + b * p.y + c);
    [wave(0.09, 0.02, 0.3), wave(-0.03, 0.08, 1.0), wave(0.05, -0.07, 2.5)]
}

/// Colour of the background.
fn outside(p: Point2<f64>) -> [f64; 3] {
    let wave = 12.0 * (math::sin(0.21 * p.x) + math::sin(0.17 * p.y + 1.0));
    [60.0 + wave, 62.0 + 0.5 * wave, 58.0 - wave]
}

/// The picture at a pose, each pixel a mean of 9 places.
pub fn draw<P: PlanarMotion>(pose: &P) -> RgbImage
where
    DefaultAllocator: Alloc<P::D>,
{
    let inverse = pose.matrix().try_inverse().unwrap();
    let outline = figure();
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..9 {
            let place = Point2::new(
                f64::from(x) + f64::from(k % 3 - 1) / 3.0,
                f64::from(y) + f64::from(k / 3 - 1) / 3.0,
            );
            let h = inverse * place.to_homogeneous();
            let p = Point2::new(h.x / h.z, h.y / h.z);
            let colour = if outline.contains(&p) { inside(p) } else { outside(place) };
            sum.iter_mut().zip(colour).for_each(|(s, c)| *s += c / 9.0);
        }
        Rgb(sum.map(|s| s.round() as u8))
    })
}

/// A step with one colour picture.
pub fn show(evidence: &mut Evidence, image: RgbImage) {
    show_at(evidence, image, Timestamp(0));
}

/// A step with one colour picture at a time.
pub fn show_at(evidence: &mut Evidence, image: RgbImage, time: Timestamp) {
    let payload = Payload::Rgb(Arc::new(image));
    evidence.begin([Frame { sensor: SENSOR, number: 0, time, payload }]);
}

/// Evidence of the picture at a pose, as a modality needs it.
pub fn prepared(unit: impl Processing + 'static, image: RgbImage) -> Evidence {
    let (mut evidence, key) = (Evidence::default(), unit.key().clone());
    evidence.add(Box::new(unit));
    show(&mut evidence, image);
    evidence.prepare(&key, None).unwrap();
    evidence
}

/// A prior with this deviation in pixels of every coordinate, as they act 30 pixels from the origin.
pub fn prior<P: PlanarMotion>(mean: P, pixels: f64) -> Gaussian<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let units = units(&mean);
    Gaussian::from_sigmas(mean, &(units * pixels))
}

/// What of every coordinate moves a point 30 pixels from the origin by a pixel.
pub fn units<P: PlanarMotion>(at: &P) -> Tangent<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let generators = P::generators(&Point2::new(30.0, 30.0));
    let mut units = at.zero();
    for k in 0..units.len() {
        units[k] = 1.0 / generators.column(k).amax();
    }
    units
}

/// A grey picture of a colour one.
#[allow(dead_code, reason = "not every test is of grey pictures")]
pub fn grey(image: &RgbImage) -> GrayImage {
    image::imageops::grayscale(image)
}

/// Any modality with what it needs.
pub type Prepared<P> = (Box<dyn Modality<P>>, Evidence);
