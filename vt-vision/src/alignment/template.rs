//! What is known of a template once and for all.

use image::GrayImage;
use nalgebra::{DefaultAllocator, Dim, Matrix3, Point2};
use vt_core::batch::{LANES, Row};
use vt_core::least_squares::Spectrum;
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::math;

use super::measure::{Influence, Pair};
use super::params::{AlignmentParams, LEAST_POINTS, TemplateError};
use super::planes::{Planes, View, level_from_picture, map, region_about};
use super::steepest::{self, Basis, Gradients, Matrix8, NOTHING, Points, Vector8};
use crate::gaussian::Gaussian;
use crate::rectangle::Rectangle;

/// Pixels of a level beside the border of the template that are not compared: smoothing mixes them with what is around.
const BORDER: f64 = 2.0;

/// Largest share of the template's half sides that the border may take.
const LARGEST_BORDER: f64 = 0.15;

/// Smallest eigenvalue of the curvature, scaled to a unit diagonal, of a motion that the template shows.
const LEAST_EIGENVALUE: f64 = 1e-6;

/// A flat object as a picture shows it: points with grey levels and gradients on every level of the pyramid.
#[derive(Clone, Debug)]
pub struct Template<P> {
    pub(super) params: AlignmentParams,
    pub(super) kernel: Gaussian,
    /// Corners in the plane of the model.
    pub(super) corners: [Point2<f64>; 4],
    /// Units of the model in a unit of the points.
    pub(super) scale: f64,
    pub(super) basis: Basis,
    /// From the finest on.
    pub(super) levels: Vec<Level>,
    pose: core::marker::PhantomData<fn() -> P>,
}

/// A template on one level.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub number: u32,
    pub points: Points,
    pub grey: Vec<Row>,
    /// Along the coordinates of the points.
    pub gradient: Gradients,
    /// `Σ J Jᵀ` of the gradients.
    pub squares: Matrix8,
    /// `Σ c J Jᵀ` over pairs of points, `c` the correlation that smoothing leaves between the noise of two points.
    pub correlated: Matrix8,
    /// Curvature of the measure of the template with itself.
    pub curvature: Matrix8,
}

impl<P: PlanarMotion> Template<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The rectangle of `size` (width, height; units of the model) about the model's origin, as `picture` shows it at the pose
    /// `picture_from_model`.
    ///
    /// # Errors
    /// [`TemplateError`] for parameters out of range, and where there is nothing to align with.
    pub fn new(
        params: AlignmentParams,
        picture: &GrayImage,
        size: [f64; 2],
        picture_from_model: &P,
    ) -> Result<Self, TemplateError> {
        let params = params.check()?;
        let corners = Rectangle::new(size)?.corners();
        let kernel = Gaussian::with_reach(params.smoothing, (2.0 * params.smoothing).ceil() as u32)?;
        if !picture_from_model.is_finite() {
            return Err(TemplateError::Pose);
        }
        let half = [0.5 * size[0], 0.5 * size[1]];
        let scale = math::hypot(half[0], half[1]);
        let matrix = scaled(&picture_from_model.matrix(), scale);
        let bounds = [f64::from(picture.width()), f64::from(picture.height())];
        let mut images = corners;
        for (corner, image) in images.iter_mut().enumerate() {
            let y = map(&matrix, &(*image / scale));
            let inside = |y: &Point2<f64>| (0..2).all(|k| y[k] >= -0.5 && y[k] <= bounds[k] - 0.5);
            *image = y.filter(inside).ok_or(TemplateError::OutOfPicture { corner })?;
        }
        let basis = Basis::of(picture_from_model, scale);
        let mut planes = Planes::default();
        if let Some(region) = region_about(&images, 16.0, picture.dimensions()) {
            planes.compute(picture, region, &kernel, params.levels as usize);
        }
        let unit = half.map(|h| h / scale);
        let mut levels = vec![];
        for number in params.finest..params.levels {
            let Some(view) = planes.level(number as usize) else { break };
            let level = Level::new(&params, &view, number, &(level_from_picture(number) * matrix), unit);
            let expected = LEAST_POINTS;
            match level {
                Ok(level) => levels.push(level),
                Err(found) if number == params.finest => return Err(TemplateError::Flat { found, expected }),
                Err(_) => break,
            }
        }
        let expected = picture_from_model.dim().value();
        let observed = |level: &Level| {
            Spectrum::new(&basis.matrix(picture_from_model, &level.squares), LEAST_EIGENVALUE).rank()
        };
        // What does not show every motion on a coarse level is of no use there.
        let useful = levels.iter().position(|l| observed(l) < expected).unwrap_or(levels.len());
        levels.truncate(useful.max(1));
        let found = levels.first().map_or(0, observed);
        if found < expected {
            return Err(TemplateError::Ambiguous { found, expected });
        }
        Ok(Self { params, kernel, corners, scale, basis, levels, pose: core::marker::PhantomData })
    }

    /// The parameters that it was made with.
    pub fn params(&self) -> &AlignmentParams {
        &self.params
    }

    /// Corners in the plane of the model, in its units, in order around it.
    pub fn corners(&self) -> [Point2<f64>; 4] {
        self.corners
    }

    /// Number of points of each level that is used, from the finest on.
    pub fn points(&self) -> impl ExactSizeIterator<Item = usize> {
        self.levels.iter().map(|level| level.points.count)
    }
}

/// A chosen point: its place, the same in pixels of the level, grey level, and gradient along the coordinates of the place.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    place: Point2<f64>,
    pixel: Point2<f64>,
    grey: f64,
    gradient: [f64; 2],
}

impl Level {
    /// The steepest place of each cell of a grid, if it is steep enough; the number of points where these are too few.
    fn new(
        params: &AlignmentParams,
        view: &View,
        number: u32,
        matrix: &Matrix3<f64>,
        half: [f64; 2],
    ) -> Result<Self, usize> {
        // Pixels of the level in a unit of the points, at the origin.
        let pixels = magnification(matrix);
        let inner = half.map(|h| h - (BORDER / pixels).min(LARGEST_BORDER * h));
        let side = (4.0 * inner[0] * inner[1] / params.points as f64).sqrt().max(1.0 / pixels);
        // A narrow strip has one row of cells, however many squares would fit along it.
        let cells = inner.map(|h| ((2.0 * h / side).round() as usize).clamp(1, params.points));
        let tries = ((side * pixels) as usize).clamp(1, 3);
        let mut grid: Vec<Option<Chosen>> = vec![None; cells[0] * cells[1]];
        for (n, cell) in grid.iter_mut().enumerate() {
            let corner = [n % cells[0], n / cells[0]];
            let mut best = params.least_gradient;
            for t in 0..tries * tries {
                let at = |k: usize, t: usize| {
                    let share = (corner[k] as f64 + (t as f64 + 0.5) / tries as f64) / cells[k] as f64;
                    inner[k] * (2.0 * share - 1.0)
                };
                let place = Point2::new(at(0, t % tries), at(1, t / tries));
                let Some(pixel) = map(matrix, &place) else { continue };
                let Some([grey, dx, dy]) = view.differentiate(pixel.x, pixel.y) else { continue };
                let steepness = math::hypot(dx, dy);
                if steepness >= best {
                    best = steepness;
                    let gradient = pulled_back(matrix, &place, &pixel, [dx, dy]);
                    *cell = Some(Chosen { place, pixel, grey, gradient });
                }
            }
        }
        let count = grid.iter().flatten().count();
        if count < LEAST_POINTS {
            return Err(count);
        }
        let blocks = count.div_ceil(LANES);
        let rows = || vec![NOTHING; blocks];
        let mut points = Points { x: rows(), y: rows(), count };
        let mut gradient = Gradients { x: rows(), y: rows() };
        let (mut grey, mut weight) = (rows(), rows());
        for (n, c) in grid.iter().flatten().enumerate() {
            let (b, k) = (n / LANES, n % LANES);
            (points.x[b][k], points.y[b][k], grey[b][k], weight[b][k]) = (c.place.x, c.place.y, c.grey, 1.0);
            (gradient.x[b][k], gradient.y[b][k]) = (c.gradient[0], c.gradient[1]);
        }
        // Beyond the last point stands its grey level, so that ranges stay what they are.
        let last = count - 1;
        let value = grey[last / LANES][last % LANES];
        grey[last / LANES][last % LANES + 1..].fill(value);
        let squares = steepest::squares(&points, &gradient, &weight);
        let correlated = correlated(&grid, cells, deviation(params.smoothing, number));
        let pair = Pair { template: &grey, picture: &grey, weight: &weight };
        let mut measure = params.similarity.measure();
        measure.begin(pair);
        measure.evaluate(pair, &mut Influence::default()).ok_or(0_usize)?;
        let curvature = measure.curvature(pair, &points, &gradient, None, &mut Gradients::default());
        Ok(Self { number, points, grey, gradient, squares, correlated, curvature })
    }
}

/// `picture_from_points` of `picture_from_model`, for points in units of `scale`.
pub(super) fn scaled(m: &Matrix3<f64>, scale: f64) -> Matrix3<f64> {
    m * Matrix3::new(scale, 0.0, 0.0, 0.0, scale, 0.0, 0.0, 0.0, 1.0)
}

/// Square root of the change of area at the origin.
fn magnification(m: &Matrix3<f64>) -> f64 {
    let (u, v) = (m.m13 / m.m33, m.m23 / m.m33);
    let [a, b] = [m.m11 - u * m.m31, m.m12 - u * m.m32];
    let [c, d] = [m.m21 - v * m.m31, m.m22 - v * m.m32];
    ((a * d - b * c) / (m.m33 * m.m33)).abs().sqrt()
}

/// A gradient in the picture as one along the coordinates of the point.
fn pulled_back(m: &Matrix3<f64>, x: &Point2<f64>, y: &Point2<f64>, [du, dv]: [f64; 2]) -> [f64; 2] {
    let depth = m.m31 * x.x + m.m32 * x.y + m.m33;
    [
        (du * (m.m11 - y.x * m.m31) + dv * (m.m21 - y.y * m.m31)) / depth,
        (du * (m.m12 - y.x * m.m32) + dv * (m.m22 - y.y * m.m32)) / depth,
    ]
}

/// Standard deviation in pixels of the level of all that smooths a grey level there: the kernel, means of blocks, and the
/// interpolation, in the mean over the places between pixels.
fn deviation(smoothing: f64, level: u32) -> f64 {
    let variance = (0..level).fold(smoothing * smoothing, |v, _| (v + 0.25) / 4.0);
    (variance + 1.0 / 6.0).sqrt()
}

/// `Σ c J Jᵀ` over all pairs of neighbours, with the correlation of white noise after Gaussian smoothing.
fn correlated(grid: &[Option<Chosen>], cells: [usize; 2], deviation: f64) -> Matrix8 {
    let row = |c: &Chosen| -> Vector8 {
        let one = |v: f64| [v; LANES];
        let j = steepest::rows(&one(c.place.x), &one(c.place.y), &one(c.gradient[0]), &one(c.gradient[1]));
        Vector8::from_fn(|r, _| j[r][0])
    };
    let rows: Vec<Option<Vector8>> = grid.iter().map(|c| c.as_ref().map(row)).collect();
    let (across, down) = (cells[0] as isize, cells[1] as isize);
    let mut sum = Matrix8::zeros();
    // Far enough for a correlation of one percent, in cells of at least a pixel.
    let reach = 4.3 * deviation;
    for (n, (chosen, j)) in grid.iter().zip(&rows).enumerate() {
        let (Some(chosen), Some(j)) = (chosen, j) else { continue };
        let (x, y) = (n as isize % across, n as isize / across);
        let far = reach.ceil() as isize;
        let mut near = Vector8::zeros();
        for v in (y - far).max(0)..(y + far + 1).min(down) {
            for u in (x - far).max(0)..(x + far + 1).min(across) {
                let other = (v * across + u) as usize;
                let (Some(c), Some(j)) = (&grid[other], &rows[other]) else { continue };
                let squared = (c.pixel - chosen.pixel).norm_squared();
                if squared < reach * reach {
                    near.axpy(math::exp(-0.25 * squared / (deviation * deviation)), j, 1.0);
                }
            }
        }
        sum += j * near.transpose();
    }
    0.5 * (sum + sum.transpose())
}
