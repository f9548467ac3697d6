//! Search of the whole picture for the colours of a lost target (M. Swain, D. Ballard, "Color indexing", 1991; paper §2).

use nalgebra::{DefaultAllocator, Dim, Matrix2, Point2, U1, Vector2};
use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Square, Tangent};

use super::kernel::{KernelPart, Lattice};
use crate::adaptation::{Adaptation, AdaptationParams};
use crate::histogram::{
    Binning, BinningParams, ColorBins, ColorBinsProcessing, Histogram, back_project, likelihood_ratio_table,
};
use crate::integral::IntegralImage;
use crate::plane::Plane;
use crate::rectangle::Rectangle;
use crate::search_region::check_prior;
use crate::turns::Turns;

/// Parameters of a [`ColorSearch`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorSearchParams {
    /// Layout of the histograms; that of a colour modality of the same sensor saves work.
    pub binning: BinningParams,
    /// Peaks that are proposed at most.
    pub proposals: usize,
    /// Least contrast of a peak, 0 to 1: mean probability of being the target's colour inside less that around.
    pub least_contrast: f64,
    /// How the colours that are searched follow what is seen; `None` for not at all.
    pub adapt: Option<AdaptationParams>,
}

impl Default for ColorSearchParams {
    fn default() -> Self {
        let binning = BinningParams::default();
        Self { binning, proposals: 3, least_contrast: 0.15, adapt: None }
    }
}

impl ColorSearchParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        self.binning.check()?;
        if !(1..=100).contains(&self.proposals) {
            return Err(ConfigError::parameter("proposals", self.proposals, "1 to 100"));
        }
        if !(0.0..1.0).contains(&self.least_contrast) {
            return Err(ConfigError::parameter("least_contrast", self.least_contrast, "0 to below 1"));
        }
        self.adapt.map(AdaptationParams::check).transpose()?;
        Ok(self)
    }
}

/// Factors on the last trusted size that are searched, where the space has a scale; neighbours differ by [`RATIO`].
const SIZES: [f64; 5] = [1.0 / (RATIO * RATIO), 1.0 / RATIO, 1.0, RATIO, RATIO * RATIO];

/// Ratio of neighbouring sizes.
const RATIO: f64 = 1.25;

/// Places along the shorter side of the box that are looked at first.
const FINENESS: u32 = 8;

/// Deviation of a peak from the target's centre, as a part of the box: colours are not spread evenly over a target.
const PLACE: f64 = 0.08;

/// Deviation of the logarithm of the scale of a peak.
const SIZE: f64 = 0.12;

/// Proposes for a lost target where its colours are dense and their surroundings lack them.
///
/// Every pixel is given the probability `p / (p + b)` of being the target's, `p` the share of its colour in the target as it
/// was trusted and `b` that in the whole picture. The mean over an upright box less that over a frame around it of the same area
/// is the contrast of a place; the places of greatest contrast, none within another's box, are proposed with a deviation of
/// 0.08 box sides and, where the space has a scale, 12 %. Sizes from 0.64 to 1.56 of the last trusted one are searched; the
/// other coordinates are those trusted last.
///
/// It learns the colours in the first step that is trusted and needs none of the evidence then, but takes that of a colour
/// modality where there is one.
pub struct ColorSearch<P> {
    params: ColorSearchParams,
    binning: Binning,
    needs: [EvidenceKey; 1],
    rectangle: Rectangle,
    whole: KernelPart,
    target: Histogram,
    adaptation: Adaptation,
    /// Factor on the deviations of the last trusted belief, which is tried first; `None` to leave it out.
    last_trusted: Option<f64>,
    own: ColorBins,
    background: Histogram,
    table: Vec<u8>,
    back: Plane<u8>,
    integral: IntegralImage,
    peaks: Vec<Peak>,
    space: core::marker::PhantomData<fn() -> P>,
}

/// A place of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Peak {
    /// Inside less around, 0 to 255.
    contrast: f64,
    /// Upper left pixel of the box.
    corner: [i64; 2],
    /// Its sides in pixels.
    sides: [i64; 2],
    /// Factor on the last trusted size.
    size: f64,
}

impl Peak {
    fn centre(&self) -> Point2<f64> {
        let along = |k: usize| self.corner[k] as f64 + 0.5 * (self.sides[k] - 1) as f64;
        Point2::new(along(0), along(1))
    }

    /// True when the centre lies in the other's box, or that one's in this.
    fn overlaps(&self, other: &Self) -> bool {
        let apart = self.centre() - other.centre();
        (0..2).all(|k| 2.0 * apart[k].abs() < self.sides[k].max(other.sides[k]) as f64)
    }
}

impl<P: PlanarMotion> ColorSearch<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Searches the colour pictures of `sensor` for an object of `width × height` in its own units.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters and sizes out of range.
    pub fn new(params: ColorSearchParams, sensor: SensorId, size: [f64; 2]) -> Result<Self, ConfigError> {
        let (params, binning) = (params.check()?, params.binning.check()?);
        let bins = usize::from(binning.count());
        // Without time to follow, the anchor is all there is.
        let adapt = params.adapt.unwrap_or(AdaptationParams { anchor: 1.0, ..Default::default() });
        Ok(Self {
            params,
            binning,
            needs: [ColorBinsProcessing::key_for(sensor, &binning)],
            rectangle: Rectangle::new(size)?,
            whole: KernelPart { centre: Point2::origin(), half_axes: Vector2::from(size) * 0.5 },
            target: Histogram::new(bins),
            adaptation: Adaptation::new(adapt),
            last_trusted: None,
            own: ColorBins::default(),
            background: Histogram::new(bins),
            table: vec![],
            back: Plane::default(),
            integral: IntegralImage::default(),
            peaks: vec![],
            space: core::marker::PhantomData,
        })
    }

    /// Tries the last trusted belief first, with its deviations multiplied by this factor.
    #[must_use]
    pub fn with_last_trusted(self, factor: f64) -> Self {
        Self { last_trusted: Some(factor), ..self }
    }

    /// Contrast of a box; `None` where less than half of the frame around it is in the picture.
    fn contrast(&self, corner: [i64; 2], sides: [i64; 2]) -> Option<f64> {
        let inside = self.integral.sums(rectangle(corner, sides));
        // The frame and the box have the same area: sides grow by √2.
        let margin = sides.map(|s| (s as f64 * 0.207).round().max(1.0) as i64);
        let outer = [corner[0] - margin[0], corner[1] - margin[1]];
        let around = self.integral.sums(rectangle(outer, [0, 1].map(|k| sides[k] + 2 * margin[k])));
        let count = around.count - inside.count;
        let seen = inside.count as i64 == sides[0] * sides[1] && 2 * count > inside.count;
        seen.then(|| inside.mean() - (around.sum - inside.sum) as f64 / count as f64)
    }

    /// The best place within `reach` pixels of a peak.
    fn refined(&self, peak: Peak, reach: i64) -> Peak {
        let shifts = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [x, y]));
        shifts.fold(peak, |best, [x, y]| {
            let corner = [peak.corner[0] + x, peak.corner[1] + y];
            match self.contrast(corner, peak.sides) {
                Some(contrast) if contrast > best.contrast => Peak { contrast, corner, ..peak },
                _ => best,
            }
        })
    }

    /// Finds the peaks of the back-projection, the best first; `box_of` gives the sides of the box by its size.
    fn find(&mut self, sides: [f64; 2], scaled: bool) {
        self.peaks.clear();
        let Roi { width, height, .. } = self.back.region();
        let sizes = if scaled { &SIZES[..] } else { &[1.0] };
        let least = 255.0 * self.params.least_contrast;
        for &size in sizes {
            let sides = sides.map(|s| (s * size).round().clamp(3.0, 1e5) as i64);
            let step = (sides[0].min(sides[1]) / i64::from(FINENESS)).max(1);
            let count = |k: usize, n: u32| (i64::from(n) - sides[k]).div_euclid(step) + 1;
            for j in 0..count(1, height) {
                for i in 0..count(0, width) {
                    let corner = [i * step, j * step];
                    let Some(contrast) = self.contrast(corner, sides).filter(|c| *c > least) else {
                        continue;
                    };
                    self.keep(Peak { contrast, corner, sides, size });
                }
            }
        }
        for k in 0..self.peaks.len() {
            let sides = self.peaks[k].sides;
            self.peaks[k] = self.refined(self.peaks[k], sides[0].min(sides[1]) / i64::from(FINENESS));
        }
    }

    /// Adds a peak to the list, which stays in order and without overlaps.
    fn keep(&mut self, peak: Peak) {
        let worse = self.peaks.iter().position(|p| p.contrast < peak.contrast);
        let place = worse.unwrap_or(self.peaks.len());
        if self.peaks[..place].iter().any(|p| p.overlaps(&peak)) || place >= self.params.proposals {
            return;
        }
        let mut k = 0;
        self.peaks.retain(|p| {
            k += 1;
            k <= place || !p.overlaps(&peak)
        });
        self.peaks.insert(place, peak);
        self.peaks.truncate(self.params.proposals);
    }

    /// The pose of a peak, `None` where the last one is degenerate.
    fn proposal(&self, peak: &Peak, last: &Gaussian<P>) -> Option<Gaussian<P>> {
        let n = last.mean.dim();
        let scale = scale_coordinate::<P>().filter(|&k| last.covariance[(k, k)] > 0.0);
        let unit = |k: usize, value: f64| {
            let mut tangent = Tangent::<P>::zeros_generic(n, U1);
            tangent[k] = value;
            tangent
        };
        let sized = match scale {
            Some(k) => last.mean.retract(&unit(k, vt_core::math::ln(peak.size))),
            None => last.mean.clone(),
        };
        let (centre, linear) = sized.about(&Point2::origin());
        let object_from_image = linear.try_inverse()?;
        let shift = object_from_image * (peak.centre() - centre);
        let mean = sized.retract(&(unit(0, shift.x) + unit(1, shift.y)));
        let mut covariance = Square::<P>::zeros_generic(n, n);
        for k in 2..n.value() {
            let widened = WIDENED * last.covariance[(k, k)];
            covariance[(k, k)] = if scale == Some(k) { SIZE * SIZE } else { widened };
        }
        let [x, y] = peak.sides.map(|s| PLACE * s as f64);
        let deviations = Matrix2::new(x, 0.0, 0.0, y);
        let root = object_from_image * deviations;
        covariance.view_mut((0, 0), (2, 2)).copy_from(&(root * root.transpose()));
        Some(Gaussian { mean, covariance })
    }
}

/// Factor on the variances of coordinates that the colours say nothing about.
const WIDENED: f64 = 9.0;

/// A box of the picture; what lies left of it or above is cut off.
fn rectangle([x, y]: [i64; 2], [width, height]: [i64; 2]) -> Roi {
    let cut = |start: i64, length: i64| (start.max(0) as u32, (length + start.min(0)).max(0) as u32);
    let ((x, width), (y, height)) = (cut(x, width), cut(y, height));
    Roi { x, y, width, height }
}

/// The coordinate that magnifies, where the space has one.
fn scale_coordinate<P: PlanarMotion>() -> Option<usize>
where
    DefaultAllocator: Alloc<P::D>,
{
    let (x, y) = (P::generators(&Point2::new(1.0, 0.0)), P::generators(&Point2::new(0.0, 1.0)));
    (2..x.ncols()).find(|&k| x.column(k) == Vector2::new(1.0, 0.0) && y.column(k) == Vector2::new(0.0, 1.0))
}

impl<P: PlanarMotion> Reinitializer<P> for ColorSearch<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    fn adapt(&mut self, evidence: &Evidence, posterior: &Gaussian<P>) -> Result<(), MeasureError> {
        let known = self.target.total() > 0.0;
        if known && self.params.adapt.is_none() {
            return Ok(());
        }
        check_prior(posterior)?;
        let frame = evidence.frame(self.needs[0].sensor)?;
        let made = evidence.get::<Turns<ColorBins>>(&self.needs[0]);
        let bins = match &made {
            Ok(turns) => turns.now(),
            Err(_) => {
                self.own.compute(frame.rgb()?, None, &self.binning);
                &self.own
            }
        };
        let count = usize::from(self.binning.count());
        let seen = self.adaptation.seen();
        seen.resize(count, 0.0);
        let whole = self.whole.visit(&bins.bins, &posterior.mean.matrix(), Lattice::ALL, |pixel| {
            if let Some(weight) = seen.get_mut(usize::from(pixel.bin)) {
                *weight += pixel.weight();
            }
        });
        let total: f64 = seen.iter().sum();
        if whole && total > 0.0 {
            seen.iter_mut().for_each(|q| *q /= total);
            if !known {
                self.adaptation.start_from_seen();
            }
            let reference = self.adaptation.blend(frame.time);
            self.target.weights_mut().iter_mut().zip(reference).for_each(|(w, q)| *w = q as f32);
        }
        Ok(())
    }

    fn forget(&mut self) {
        self.target.clear();
        self.adaptation.forget();
    }

    fn propose(
        &mut self,
        evidence: &Evidence,
        last: &Gaussian<P>,
        out: &mut Vec<Gaussian<P>>,
    ) -> Result<(), MeasureError> {
        if let Some(factor) = self.last_trusted {
            out.push(Gaussian { mean: last.mean.clone(), covariance: &last.covariance * (factor * factor) });
        }
        if self.target.total() <= 0.0 {
            return Ok(());
        }
        check_prior(last)?;
        let picture = evidence.frame(self.needs[0].sensor)?.rgb()?;
        let all = Roi { x: 0, y: 0, width: picture.width(), height: picture.height() };
        let made = evidence.get::<Turns<ColorBins>>(&self.needs[0]).ok().map(Turns::now);
        let bins = match made.filter(|made| made.bins.region() == all) {
            Some(made) => made,
            None => {
                self.own.compute(picture, None, &self.binning);
                &self.own
            }
        };
        self.background.clear();
        self.background.add_region(&bins.bins, all);
        likelihood_ratio_table(&self.target, &self.background, 0, &mut self.table);
        back_project(&bins.bins, &self.table, &mut self.back);
        self.integral.compute(&self.back);
        // Upright box around the object at the last trusted pose.
        let a = last.mean.about(&Point2::origin()).1;
        let corners = self.rectangle.corners().map(|corner| a * corner.coords);
        let sides = [0, 1].map(|k| 2.0 * corners.iter().fold(0.0, |most: f64, c| most.max(c[k].abs())));
        let scaled = scale_coordinate::<P>().is_some_and(|k| last.covariance[(k, k)] > 0.0);
        self.find(sides, scaled);
        out.extend(self.peaks.iter().filter_map(|peak| self.proposal(peak, last)));
        Ok(())
    }
}
