//! Errors that cross crate borders. Each says what was found and what was expected.

use thiserror::Error;

/// A component cannot be built from these parameters.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// A parameter is out of its range.
    #[error("`{key}` is {found}; expected {expected}")]
    Parameter {
        /// Name of the parameter as a user writes it.
        key: &'static str,
        /// The value given.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// Two components do not fit together.
    #[error("{found} does not fit: expected {expected}")]
    Mismatch {
        /// What was given.
        found: String,
        /// What fits.
        expected: String,
    },
}

impl ConfigError {
    /// A parameter out of its range.
    pub fn parameter(key: &'static str, found: impl ToString, expected: impl ToString) -> Self {
        Self::Parameter { key, found: found.to_string(), expected: expected.to_string() }
    }
}

/// One frame cannot be measured; the next one may.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// Evidence that the modality named in its needs is not there.
    #[error("evidence `{key}` of sensor {sensor} is missing: no processing of that key ran on this frame")]
    MissingEvidence {
        /// Name of the evidence.
        key: std::sync::Arc<str>,
        /// Number of the sensor.
        sensor: u32,
    },
    /// Evidence is there, but of another type.
    #[error("evidence `{key}` is not a {expected}")]
    EvidenceType {
        /// Name of the evidence.
        key: std::sync::Arc<str>,
        /// Type asked for.
        expected: &'static str,
    },
    /// No frame of this sensor in this step.
    #[error("no frame of sensor {sensor} in this step")]
    MissingFrame {
        /// Number of the sensor.
        sensor: u32,
    },
    /// The frame carries another payload.
    #[error("sensor {sensor} gave {found}; expected {expected}")]
    Payload {
        /// Number of the sensor.
        sensor: u32,
        /// What came.
        found: String,
        /// What is needed.
        expected: String,
    },
    /// The predicted pose is not finite or otherwise of no use.
    #[error("prediction of no use: {0}")]
    Prediction(&'static str),
}

/// Numbers on which an estimate cannot be made.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EstimateError {
    /// NaN or infinity in an argument.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A matrix that must be positive definite is not.
    #[error("{0} is not positive definite")]
    NotPositiveDefinite(&'static str),
    /// Sizes that do not fit.
    #[error("{what} has dimension {found}; expected {expected}")]
    Dimension {
        /// Which argument.
        what: &'static str,
        /// Its dimension.
        found: usize,
        /// The dimension that fits.
        expected: usize,
    },
    /// A belief of another pose space.
    #[error("a belief of the space `{found}` with {numbers} coordinates; expected one of `{expected}`")]
    Space {
        /// Space of the belief.
        found: &'static str,
        /// Number of its coordinates.
        numbers: usize,
        /// Space that fits.
        expected: &'static str,
    },
    /// A combination that has no meaning or no implementation.
    #[error("not supported: {0}")]
    Unsupported(&'static str),
    /// A measurement older than what is remembered.
    #[error("a measurement comes {seconds} s too late")]
    TooLate {
        /// Time by which it is too old, or its age.
        seconds: f64,
    },
    /// A parameter of the estimator is out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A particle filter without particles.
    #[error("no particles")]
    NoParticles,
    /// All hypotheses have zero likelihood.
    #[error("all likelihoods are zero")]
    ZeroLikelihood,
}

impl EstimateError {
    /// [`Self::Dimension`] unless both are equal.
    ///
    /// # Errors
    /// As said.
    pub fn unless_equal(what: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Dimension { what, found, expected }) }
    }
}

/// A sensor or an output failed.
#[derive(Debug, Error)]
#[error("{what}: {why}")]
pub struct DeviceError {
    /// File, folder or device.
    pub what: String,
    /// What was found and what was expected.
    pub why: String,
}

impl DeviceError {
    /// An error of the file, folder or device `what`.
    pub fn new(what: impl ToString, why: impl ToString) -> Self {
        Self { what: what.to_string(), why: why.to_string() }
    }
}
