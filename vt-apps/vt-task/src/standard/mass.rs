//! Modalities that measure mass centres: `motion-centre`, of what moves, and `color-centre`, of what has the object's colours.

use nalgebra::DefaultAllocator;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::manifold::Alloc;
use vt_core::time::Seconds;
use vt_models::warp::PlanarWarp;
use vt_vision::discriminant::DiscriminantParams;
use vt_vision::mass_centre::{
    ColorMass, MassCentreModality, MassCentreParams, MassSource, MotionMass, MotionWeights,
};
use vt_vision::motion::{self, MotionParams};

use super::looks::{reference, size};
use super::planar::PlanarSpace;
use crate::language::FilePath;
use crate::quantity::Span;
use crate::registry::Params;
use crate::roles::{ModalityContext, ModalityProduct};

/// How a mass centre is measured, whatever the mass is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Centre {
    /// Share of the object's box that its mass fills; what the first frame shows where that is known.
    pub share: f64,
    /// Part of the expected mass that is as good as all of it: more may be another's.
    pub enough: f64,
    /// Log-likelihood that a place loses where all that mass is missing.
    pub sharpness: f64,
    /// Likelihood that the object is hidden, over that of a place with its mass.
    pub hidden: f64,
    /// Time in which the expected mass follows what is seen of the target by two thirds.
    pub follows: Span,
    /// Error of the mass centre as the place of the object, as a standard deviation over the object's width and height.
    pub wobble: f64,
    /// Half size of the search, and of what is taken for the target, in predicted deviations.
    pub deviations: f64,
}

impl Default for Centre {
    fn default() -> Self {
        let MassCentreParams { share, enough, sharpness, hidden, follows, wobble, deviations } =
            Default::default();
        // A finite number of a known unit always is a quantity.
        let follows = Span::new(follows.0, "s").unwrap_or_default();
        Self { share, enough, sharpness, hidden, follows, wobble, deviations }
    }
}

impl Centre {
    fn params(&self) -> Result<MassCentreParams, ConfigError> {
        let Self { share, enough, sharpness, hidden, follows, wobble, deviations } = *self;
        let follows = Seconds(follows.si());
        MassCentreParams { share, enough, sharpness, hidden, follows, wobble, deviations }.check()
    }

    fn modality<P: PlanarSpace, S: MassSource + 'static>(
        &self,
        source: S,
        context: &ModalityContext<'_>,
    ) -> Result<MassCentreModality<P, S>, ConfigError>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        MassCentreModality::new(self.params()?, source, PlanarWarp::default(), size(context.shape)?)
    }
}

/// With what a frame is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Compared {
    /// The frame before.
    Two,
    /// Each of the two frames before.
    Three,
    /// The picture of what stands still.
    #[default]
    Still,
}

/// What has weight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Weights {
    /// What moves now.
    #[default]
    Newest,
    /// What moved within `duration`, the newer the heavier.
    History,
}

/// Parameters of the modality `motion-centre`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionCentre {
    /// Grey levels that a pixel must change by more.
    pub threshold: u8,
    /// With what a frame is compared.
    pub compared: Compared,
    /// Age at which motion is forgotten, and for which a pixel must stand still to be of the background.
    pub duration: Span,
    /// Time after which what stands before the background is taken for part of it.
    pub absorbed: Span,
    /// What has weight.
    pub weights: Weights,
    /// How the centre is measured.
    pub centre: Centre,
}

impl Default for MotionCentre {
    fn default() -> Self {
        let (compared, weights) = Default::default();
        // A finite number of a known unit always is a quantity.
        let [duration, absorbed] = [2.0, 10.0].map(|s| Span::new(s, "s").unwrap_or_default());
        Self { threshold: 15, compared, duration, absorbed, weights, centre: Centre::default() }
    }
}

impl MotionCentre {
    fn motion(&self) -> Result<MotionParams, ConfigError> {
        let compared = match self.compared {
            Compared::Two => motion::Compared::Two,
            Compared::Three => motion::Compared::Three,
            Compared::Still => motion::Compared::Still,
        };
        let [duration, absorbed] = [self.duration, self.absorbed].map(|s| Seconds(s.si()));
        MotionParams { threshold: self.threshold, compared, duration, absorbed }.check()
    }
}

impl Params for MotionCentre {
    fn check(&self) -> Result<(), ConfigError> {
        self.motion()?;
        self.centre.params().map(drop)
    }
}

pub(super) fn motion_centre<P: PlanarSpace>(
    p: MotionCentre,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let weights = match p.weights {
        Weights::Newest => MotionWeights::Newest,
        Weights::History => MotionWeights::History,
    };
    let source = MotionMass::new(context.sensor, p.motion()?, weights);
    let processing = Box::new(source.processing());
    let modality = p.centre.modality(source, &context)?;
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] })
}

/// Parameters of the modality `color-centre`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ColorCentre {
    /// Probability that a pixel is the object's before its colour is seen.
    pub prior: f64,
    /// Keeps directions of colour in which pixels do not vary from deciding alone: variance over the mean one.
    pub regularization: f64,
    /// Picture of the object alone, which fills it; the object at the start when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<FilePath>,
    /// How the centre is measured; `share` is that of the first frame.
    pub centre: Centre,
}

impl Default for ColorCentre {
    fn default() -> Self {
        let DiscriminantParams { prior, regularization, .. } = DiscriminantParams::default();
        Self { prior, regularization, reference: None, centre: Centre::default() }
    }
}

impl ColorCentre {
    fn discriminant(&self) -> Result<DiscriminantParams, ConfigError> {
        let Self { prior, regularization, .. } = *self;
        DiscriminantParams { prior, regularization, ..Default::default() }.check()
    }
}

impl Params for ColorCentre {
    fn check(&self) -> Result<(), ConfigError> {
        self.discriminant()?;
        self.centre.params().map(drop)
    }
    fn files(&self) -> Vec<(String, FilePath)> {
        self.reference.iter().map(|f| ("reference".to_owned(), f.clone())).collect()
    }
}

pub(super) fn color_centre<P: PlanarSpace>(
    p: ColorCentre,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut source = ColorMass::new(context.sensor, p.discriminant()?)?;
    if let Some(file) = &p.reference {
        source = source.with_reference(&reference(file, &context)?.0)?;
    }
    let modality = p.centre.modality(source, &context)?;
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![] })
}
