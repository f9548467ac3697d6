//! Line segments from chains of edge pixels: chains are split where they bend, and a line is fitted to each part by total least
//! squares.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};
use vt_core::error::ConfigError;

use crate::canny::Canny;
use crate::plane::Plane;

/// Points at both ends of a part of a chain that do not count.
const ROUNDED: usize = 3;

/// What is a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentParams {
    /// Farthest that a point of a chain may lie from the chord of its part, pixels.
    pub tolerance: f64,
    /// Least number of edge pixels; three more at either end are left out, since smoothing rounds corners.
    pub min_points: usize,
    /// Least deviation of an edge pixel across its edge, pixels: small residuals by chance do not make it smaller.
    pub least_deviation: f64,
    /// Number of neighbours along an edge whose errors are one error: smoothing and the grid make them alike.
    pub correlation: f64,
}

impl Default for SegmentParams {
    fn default() -> Self {
        Self { tolerance: 1.0, min_points: 12, least_deviation: 0.05, correlation: 3.0 }
    }
}

impl SegmentParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let positive = |key, v: f64, least: f64| {
            if v >= least && v.is_finite() {
                return Ok(());
            }
            Err(ConfigError::parameter(key, v, format!("{least} or more")))
        };
        positive("tolerance", self.tolerance, 0.1)?;
        positive("min_points", self.min_points as f64, 3.0)?;
        positive("least_deviation", self.least_deviation, 1e-6)?;
        positive("correlation", self.correlation, 1.0)?;
        Ok(self)
    }
}

/// A piece of a straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Mean of its points.
    pub centre: Point2<f64>,
    /// Unit vector along it.
    pub direction: Vector2<f64>,
    /// First and last point, from the centre along the direction, pixels.
    pub extent: [f64; 2],
    /// Number of edge pixels.
    pub points: usize,
    /// Deviation of the points across the line, pixels.
    pub deviation: f64,
    /// Covariance of the line: shift of the centre across it in pixels (to the left of the direction, x towards y), turn in radians.
    pub covariance: Matrix2<f64>,
}

impl Segment {
    /// The line through points by total least squares. None for fewer than three points or when all are one.
    pub fn fit(points: &[Point2<f64>], params: &SegmentParams) -> Option<Self> {
        let n = points.len() as f64;
        if points.len() < 3 {
            return None;
        }
        let centre = Point2::from(points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / n);
        let scatter: Matrix2<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(scatter);
        let long = eigenvalues.imax();
        if eigenvalues[long].is_nan() || eigenvalues[long] <= 0.0 {
            return None;
        }
        let mut direction: Vector2<f64> = eigenvectors.column(long).into_owned();
        // From the first point to the last.
        if direction.dot(&(points[points.len() - 1] - points[0])) < 0.0 {
            direction = -direction;
        }
        let across = eigenvalues[1 - long].max(0.0);
        let deviation = (across / (n - 2.0)).sqrt();
        // Shift σ² / n, turn σ² / Σ t², with as many points as there are independent ones; both do not hang together, as they
        // are about the centre.
        let variance = deviation.max(params.least_deviation).powi(2) * params.correlation;
        let along = |p: &Point2<f64>| (p - centre).dot(&direction);
        let extent = points.iter().map(along).fold([0.0f64, 0.0f64], |[a, b], t| [a.min(t), b.max(t)]);
        let covariance = Matrix2::new(variance / n, 0.0, 0.0, variance / eigenvalues[long]);
        Some(Self { centre, direction, extent, points: points.len(), deviation, covariance })
    }

    /// Both ends.
    pub fn ends(&self) -> [Point2<f64>; 2] {
        self.extent.map(|t| self.centre + self.direction * t)
    }

    /// Length, pixels.
    pub fn length(&self) -> f64 {
        self.extent[1] - self.extent[0]
    }
}

/// Finds the segments among the edges of a picture.
#[derive(Clone, Debug, Default)]
pub struct SegmentDetector {
    /// Edge pixels that no chain has yet.
    free: Plane<u8>,
    chain: Vec<(u32, u32)>,
    points: Vec<Point2<f64>>,
    open: Vec<(usize, usize)>,
    segments: Vec<Segment>,
}

impl SegmentDetector {
    /// The segments of the edges, chain by chain.
    pub fn detect(&mut self, edges: &Canny, params: &SegmentParams) -> &[Segment] {
        self.segments.clear();
        let region = edges.mask().region();
        self.free.reshape(region).copy_from_slice(edges.mask().values());
        // Open chains from their ends first; what is left then are closed ones.
        for closed in [false, true] {
            for y in region.y..region.y + region.height {
                for x in region.x..region.x + region.width {
                    if self.is_free(x, y) && (closed || self.neighbours(x, y).count() == 1) {
                        self.follow(x, y);
                        self.split(edges, params);
                    }
                }
            }
        }
        &self.segments
    }

    fn is_free(&self, x: u32, y: u32) -> bool {
        self.free.get(x, y).is_some_and(|m| m != 0)
    }

    /// Free pixels around one: first those that share a side with it.
    fn neighbours(&self, x: u32, y: u32) -> impl Iterator<Item = (u32, u32)> {
        let steps = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];
        let places =
            steps.into_iter().map(move |(dx, dy)| (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy)));
        places.filter(|&(u, v)| self.is_free(u, v))
    }

    /// Takes a chain of free pixels that begins at one.
    fn follow(&mut self, x: u32, y: u32) {
        self.chain.clear();
        let mut next = Some((x, y));
        while let Some((x, y)) = next {
            let region = self.free.region();
            let at = (y - region.y) as usize * region.width as usize + (x - region.x) as usize;
            self.free.values_mut()[at] = 0;
            self.chain.push((x, y));
            next = self.neighbours(x, y).next();
        }
    }

    /// Splits the chain at its farthest point from the chord until all parts are straight, and fits a line to each (Douglas and
    /// Peucker, 1973).
    fn split(&mut self, edges: &Canny, params: &SegmentParams) {
        self.points.clear();
        self.points.extend(self.chain.iter().filter_map(|&(x, y)| edges.get(x, y)).map(|e| e.at));
        self.open.clear();
        self.open.push((0, self.points.len()));
        while let Some((from, to)) = self.open.pop() {
            if to - from < params.min_points + 2 * ROUNDED {
                continue;
            }
            let part = &self.points[from..to];
            let (first, last) = (part[0], part[part.len() - 1]);
            let chord = (last - first).try_normalize(1.0);
            let off = |p: &Point2<f64>| {
                let d = p - first;
                chord.map_or(d.norm(), |c| c.perp(&d).abs())
            };
            let far = part.iter().map(off).enumerate().fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
            if far.1 > params.tolerance {
                self.open.push((from + far.0, to));
                self.open.push((from, from + far.0 + 1));
            } else {
                // Smoothing rounds corners: the outermost points belong to two lines.
                let inner = &part[ROUNDED..part.len() - ROUNDED];
                self.segments.extend(Segment::fit(inner, params));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canny::{CannyParams, Thresholds};
    use image::{GrayImage, Luma};
    use vt_core::math;
    use vt_core::random::{Random, Stream};

    fn canny(image: &GrayImage) -> Canny {
        let mut canny = Canny::default();
        canny.compute(image, None, &CannyParams::new(Thresholds::Fixed { low: 10.0, high: 20.0 }).unwrap());
        canny
    }

    #[test]
    fn the_sides_of_a_polygon_are_found() {
        // A turned rectangle of 50 by 30 pixels.
        let (s, c) = math::sin_cos(0.35);
        let image = GrayImage::from_fn(100, 80, |x, y| {
            let mut share = 0;
            for i in 0..16 {
                let d = Vector2::new(
                    f64::from(x) - 50.0 + f64::from(i % 4) / 4.0 - 0.375,
                    f64::from(y) - 40.0 + f64::from(i / 4) / 4.0 - 0.375,
                );
                share += u32::from((c * d.x + s * d.y).abs() < 25.0 && (c * d.y - s * d.x).abs() < 15.0);
            }
            Luma([(60 + 6 * share) as u8])
        });
        let mut detector = SegmentDetector::default();
        let found = detector.detect(&canny(&image), &SegmentParams::default());
        assert_eq!(found.len(), 4, "{found:?}");
        for segment in found {
            let (along, across) = (Vector2::new(c, s), Vector2::new(-s, c));
            let wide = segment.direction.dot(&along).abs() > 0.7;
            let (axis, distance, length) = if wide { (along, 15.0, 50.0) } else { (across, 25.0, 30.0) };
            assert!(segment.direction.perp(&axis).abs() < 0.01, "{segment:?}");
            let off =
                (segment.centre - Point2::new(50.0, 40.0)).dot(&if wide { across } else { along }).abs();
            assert!((off - distance).abs() < 0.1, "{segment:?}");
            assert!((segment.length() - length).abs() < 10.0, "{segment:?}");
            assert!(segment.deviation < 0.15, "{segment:?}");
        }
    }

    #[test]
    fn lines_are_as_certain_as_they_say() {
        let params = SegmentParams { least_deviation: 1e-3, correlation: 1.0, ..SegmentParams::default() };
        let (direction, centre) = (Vector2::new(0.8, 0.6), Point2::new(30.0, 20.0));
        let mut nees = 0.0;
        for trial in 0..2000 {
            let mut random = Random::new(5, Stream::Sim, 0, trial, 0);
            let points: Vec<_> = (0..40)
                .map(|k| {
                    let t = f64::from(k) - 19.5;
                    centre + direction * t + Vector2::new(-0.6, 0.8) * (0.2 * random.normal())
                })
                .collect();
            let found = Segment::fit(&points, &params).unwrap();
            let shift = Vector2::new(-direction.y, direction.x).dot(&(found.centre - centre));
            let turn = math::asin(direction.perp(&found.direction));
            let d = Vector2::new(shift, turn);
            nees += (found.covariance.try_inverse().unwrap() * d).dot(&d) / 2000.0;
        }
        // Two rows with an estimated variance of 38 degrees of freedom: the mean of F is 2 · 38 / 36.
        assert!((nees - 2.0 * 38.0 / 36.0).abs() < 0.15, "{nees}");
    }

    #[test]
    fn odd_chains_give_no_segment_and_no_panic() {
        let params = SegmentParams::default().check().unwrap();
        assert_eq!(Segment::fit(&[Point2::origin(); 9], &params), None);
        assert_eq!(Segment::fit(&[Point2::origin(); 2], &params), None);
        let mut detector = SegmentDetector::default();
        let noise =
            GrayImage::from_fn(60, 50, |x, y| Luma([((x * 7919 + y * 104_729 + x * y * 31) % 256) as u8]));
        for segment in detector.detect(&canny(&noise), &params) {
            assert!(segment.points >= params.min_points && segment.deviation <= 2.0 * params.tolerance);
        }
        assert!(detector.detect(&Canny::default(), &params).is_empty());
        for wrong in
            [SegmentParams { tolerance: f64::NAN, ..params }, SegmentParams { min_points: 1, ..params }]
        {
            assert!(wrong.check().is_err());
        }
    }
}
