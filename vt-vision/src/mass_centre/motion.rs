//! The mass of what moves.

use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};

use super::MassSource;
use crate::motion::{Motion, MotionParams, MotionProcessing};
use crate::plane::Plane;

/// What of the motion has weight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionWeights {
    /// What moves in the newest frame, all the same.
    #[default]
    Newest,
    /// The history: the newer the heavier.
    History,
}

/// Weights by motion, from the evidence of [`MotionProcessing`].
pub struct MotionMass {
    params: MotionParams,
    weights: MotionWeights,
    needs: [EvidenceKey; 1],
    recency: Plane<u8>,
}

impl MotionMass {
    /// What moves in the pictures of `sensor`.
    pub fn new(sensor: SensorId, params: MotionParams, weights: MotionWeights) -> Self {
        let needs = [MotionProcessing::key_for(sensor, &params)];
        Self { params, weights, needs, recency: Plane::default() }
    }

    /// The processing unit whose evidence this source reads.
    pub fn processing(&self) -> MotionProcessing {
        MotionProcessing::new(self.needs[0].sensor, self.params)
    }
}

impl MassSource for MotionMass {
    const SEEN_AT_START: bool = false;

    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    fn weigh<'a>(
        &'a mut self,
        evidence: &'a Evidence,
        region: Roi,
        _: Roi,
    ) -> Result<Option<&'a Plane<u8>>, MeasureError> {
        evidence.frame(self.needs[0].sensor)?;
        let motion: &Motion = evidence.get(&self.needs[0])?;
        Ok(Some(match self.weights {
            MotionWeights::Newest => motion.mask(),
            MotionWeights::History => {
                motion.history().recency(region, &mut self.recency);
                &self.recency
            }
        }))
    }
}
