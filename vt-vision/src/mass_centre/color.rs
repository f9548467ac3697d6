//! The mass of what has the target's colours.

use image::RgbImage;
use nalgebra::SVector;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};

use super::MassSource;
use crate::color::rows;
use crate::discriminant::{
    ClassStatistics, ColorPosterior, DiscriminantError, DiscriminantParams, FisherDiscriminant,
};
use crate::plane::{Plane, clip};

/// How often the object's class is made anew of the pixels that look like it.
const ROUNDS: usize = 3;

/// Weights by colour: the posterior of Fisher's discriminant between the object and a ring around it of the same area, both as the
/// first frame shows them, or the object as a reference picture does. It reads frames itself, and learns nothing later.
pub struct ColorMass {
    sensor: SensorId,
    params: DiscriminantParams,
    given: Option<ClassStatistics<3>>,
    discriminant: Option<FisherDiscriminant<3>>,
    posterior: ColorPosterior,
    plane: Plane<u8>,
}

impl ColorMass {
    /// Colours in the pictures of `sensor`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range.
    pub fn new(sensor: SensorId, params: DiscriminantParams) -> Result<Self, ConfigError> {
        let params = params.check()?;
        let (posterior, plane) = (ColorPosterior::default(), Plane::default());
        Ok(Self { sensor, params, given: None, discriminant: None, posterior, plane })
    }

    /// Takes the object's colours from a picture that it fills; those around it are still those of the first frame.
    ///
    /// # Errors
    /// [`ConfigError::Mismatch`] for a picture of one pixel.
    pub fn with_reference(mut self, picture: &RgbImage) -> Result<Self, ConfigError> {
        let (width, height) = picture.dimensions();
        let mut statistics = ClassStatistics::default();
        statistics.add_region(picture, Roi { x: 0, y: 0, width, height }, None);
        if statistics.weight() <= 1.0 {
            let found = format!("a reference of {width} x {height} pixels");
            return Err(ConfigError::Mismatch { found, expected: "two pixels or more".into() });
        }
        self.given = Some(statistics);
        Ok(self)
    }

    /// What tells the object's colours from those around it, once it is known.
    pub fn discriminant(&self) -> Option<&FisherDiscriminant<3>> {
        self.discriminant.as_ref()
    }

    fn learn(&self, picture: &RgbImage, object: Roi) -> Result<FisherDiscriminant<3>, DiscriminantError> {
        let own = self.given.unwrap_or_else(|| {
            let mut own = ClassStatistics::default();
            own.add_region(picture, object, None);
            own
        });
        let mut around = ClassStatistics::default();
        around.add_region(picture, ring(object), Some(object));
        let mut fisher = FisherDiscriminant::fit(&own, &around, &self.params)?;
        // A box holds background too: what of it looks like that counts less.
        for _ in 0..if self.given.is_some() { 0 } else { ROUNDS } {
            let mut purer = ClassStatistics::default();
            let part = clip(Some(object), picture.dimensions(), 0);
            for row in rows(picture, part) {
                for p in row.chunks_exact(3) {
                    let colour = SVector::from([p[0], p[1], p[2]].map(f64::from));
                    let [high, low] = fisher.means();
                    purer.add(&colour, fisher.posterior(fisher.score(&colour).clamp(low, high)));
                }
            }
            fisher = FisherDiscriminant::fit(&purer, &around, &self.params)?;
        }
        Ok(fisher)
    }
}

/// The box around `object` with twice its area.
fn ring(object: Roi) -> Roi {
    let margin = |n: u32| (f64::from(n) * 0.5 * (core::f64::consts::SQRT_2 - 1.0)).round().max(1.0) as u32;
    let (x, y) = (margin(object.width), margin(object.height));
    let (left, top) = (object.x.saturating_sub(x), object.y.saturating_sub(y));
    let end = |p: u32, n: u32, m: u32| p.saturating_add(n).saturating_add(m);
    let (right, bottom) = (end(object.x, object.width, x), end(object.y, object.height, y));
    Roi { x: left, y: top, width: right - left, height: bottom - top }
}

impl MassSource for ColorMass {
    const SEEN_AT_START: bool = true;

    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }

    /// Colours that cannot be told from those around them have no weights.
    fn weigh<'a>(
        &'a mut self,
        evidence: &'a Evidence,
        region: Roi,
        object: Roi,
    ) -> Result<Option<&'a Plane<u8>>, MeasureError> {
        let picture = evidence.frame(self.sensor)?.rgb()?;
        if self.discriminant.is_none() {
            self.discriminant = self.learn(picture, object).ok();
        }
        let Some(discriminant) = &self.discriminant else { return Ok(None) };
        self.posterior.compute(picture, Some(region), discriminant, &mut self.plane);
        Ok(Some(&self.plane))
    }

    fn forget(&mut self) {
        self.discriminant = None;
    }
}
