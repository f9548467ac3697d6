//! Parameters of the alignment, and what can go wrong.

use thiserror::Error;
use vt_core::error::ConfigError;
use vt_core::robust::Robust;

/// How alike template and picture are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Similarity {
    /// Sum of squared differences after the best gain and bias, of either sign.
    Ssd,
    /// Zero-mean normalised cross-correlation: gain and bias do not count, inverted contrast is unlike.
    Zncc,
    /// Sum of conditional variance: squared differences after the best curve from the template's grey levels to the picture's.
    Scv,
    /// Mutual information: any relation between the grey levels, also one of several values.
    MutualInformation,
    /// Normalised mutual information `(H(T) + H(I)) / H(T, I)`, which depends less on how much is in view.
    NormalizedMutualInformation,
}

impl Similarity {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Ssd, Self::Zncc, Self::Scv, Self::MutualInformation, Self::NormalizedMutualInformation];

    /// True of measures by the joint histogram of the grey levels.
    pub fn is_information(self) -> bool {
        matches!(self, Self::MutualInformation | Self::NormalizedMutualInformation)
    }
}

/// How steps are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Method {
    /// Inverse compositional: slopes of the template, the curvature once for every level; of measures by information it is
    /// that of the template with itself.
    InverseCompositional,
    /// Efficient second-order minimisation: mean slopes of template and picture, the curvature anew in every step; of measures by
    /// information it is that of the template with itself.
    Esm,
}

/// Parameters of [`super::Template`] and [`super::Aligner`]. Pixels are those of the full picture unless a level's are named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentParams {
    /// The measure.
    pub similarity: Similarity,
    /// The way of its steps.
    pub method: Method,
    /// Number of pyramid levels, the full picture included. Those on which the template has too few points are left out.
    pub levels: u32,
    /// The level at which the descent ends: 0 is the full picture, 1 the halved one.
    pub finest: u32,
    /// Standard deviation of the smoothing of the full picture, pixels.
    pub smoothing: f64,
    /// About how many points are compared on each level.
    pub points: usize,
    /// Least gradient of a point, grey levels a pixel of its level.
    pub least_gradient: f64,
    /// M-estimator of the grey-level residuals, in units of their scale; not for measures by information.
    pub robust: Option<Robust>,
    /// Most steps on each level.
    pub iterations: u32,
    /// A step that moves no corner farther than this many pixels of the level is the last one on the finest level; ten times as many
    /// on the coarser ones.
    pub tolerance: f64,
    /// Least share of the points that must be in the picture.
    pub least_inside: f64,
    /// How far corners may be from where the start has them, pixels: the picture is smoothed so far around it.
    pub reach: f64,
}

impl Default for AlignmentParams {
    fn default() -> Self {
        Self {
            similarity: Similarity::Zncc,
            method: Method::Esm,
            levels: 3,
            finest: 0,
            smoothing: 1.0,
            points: 2000,
            least_gradient: 1.0,
            robust: None,
            iterations: 30,
            tolerance: 0.01,
            least_inside: 0.5,
            reach: 24.0,
        }
    }
}

impl AlignmentParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let positive = |key, value: f64, most: f64| {
            let fits = value > 0.0 && value <= most;
            let expected = || format!("above 0, at most {most}");
            if fits { Ok(()) } else { Err(ConfigError::parameter(key, value, expected())) }
        };
        if !(1..=8).contains(&self.levels) {
            return Err(ConfigError::parameter("levels", self.levels, "1 to 8"));
        }
        if self.finest >= self.levels {
            return Err(ConfigError::parameter("finest", self.finest, "below `levels`"));
        }
        positive("smoothing", self.smoothing, 21.0)?;
        if !(LEAST_POINTS..=1_000_000).contains(&self.points) {
            return Err(ConfigError::parameter("points", self.points, "64 to a million"));
        }
        positive("least_gradient", self.least_gradient, 255.0)?;
        if let Some(kind) = self.robust {
            kind.checked()?;
            if self.similarity.is_information() {
                return Err(ConfigError::parameter("robust", format!("{kind:?}"), "none with information"));
            }
        }
        if !(1..=1000).contains(&self.iterations) {
            return Err(ConfigError::parameter("iterations", self.iterations, "1 to 1000"));
        }
        positive("tolerance", self.tolerance, 1.0)?;
        positive("least_inside", self.least_inside, 1.0)?;
        positive("reach", self.reach, 1e4)?;
        Ok(self)
    }
}

/// Fewest points that are compared.
pub(super) const LEAST_POINTS: usize = 64;

/// There is no template to be had.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TemplateError {
    /// A parameter or a size is out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The pose is not finite.
    #[error("the pose of the template is not finite")]
    Pose,
    /// Part of the template is not in the picture.
    #[error("corner {corner} of the template lies outside of the picture")]
    OutOfPicture {
        /// Which one, clockwise from the top left.
        corner: usize,
    },
    /// Too few places with a gradient.
    #[error("{found} places of the template have a gradient; expected at least {expected}")]
    Flat {
        /// Number of places.
        found: usize,
        /// Number that is enough.
        expected: usize,
    },
    /// Grey levels that look the same after some motions, such as stripes.
    #[error("the template determines {found} of {expected} degrees of freedom")]
    Ambiguous {
        /// Number of degrees of freedom that it determines.
        found: usize,
        /// That of the motion.
        expected: usize,
    },
}

/// One picture cannot be aligned; the next one may.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum AlignmentError {
    /// The start is not finite.
    #[error("the start is not finite")]
    Start,
    /// Too little of the template is in the picture, at the start or after a step.
    #[error("{inside} of {points} points of the template are in the picture")]
    OutOfPicture {
        /// Number of points in the picture.
        inside: usize,
        /// Number of all points.
        points: usize,
    },
    /// The picture has no contrast where the template is looked for.
    #[error("the picture is flat where the template is looked for")]
    Flat,
    /// Template and picture do not determine the step.
    #[error("template and picture do not determine a step")]
    Singular,
}
