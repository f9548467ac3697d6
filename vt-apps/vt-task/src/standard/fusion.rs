//! Fusion of several modalities of a target: static, before its estimator, or dynamic, of a track for each.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_fusion::stacked::StaticFusion;
use vt_fusion::tracks;

use crate::registry::{NoParams, Params};
use crate::roles::{FusionProduct, TrackRule};

/// Parameters of the fusions `bar-shalom-campo` and `equivalent-measurements`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Dynamic {
    /// Whether a track that is lost, or not where the fused pose is, starts again there.
    pub feedback: bool,
}

impl Params for Dynamic {}

/// What the weights of an intersection make smallest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// The volume of the covariance.
    #[default]
    Determinant,
    /// The mean square error; for poses of one unit.
    Trace,
}

/// Parameters of the fusion `intersection`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Intersection {
    /// What the weights make smallest.
    pub criterion: Criterion,
    /// Whether a track that is lost, or not where the fused pose is, starts again there.
    pub feedback: bool,
}

impl Params for Intersection {}

type Built = Result<FusionProduct, ConfigError>;

pub(super) fn stacked(_: NoParams, _: ()) -> Built {
    Ok(FusionProduct::Static(StaticFusion::Stacked))
}

pub(super) fn sequential(_: NoParams, _: ()) -> Built {
    Ok(FusionProduct::Static(StaticFusion::Sequential))
}

pub(super) fn information_sum(_: NoParams, _: ()) -> Built {
    Ok(FusionProduct::Static(StaticFusion::InformationSum))
}

pub(super) fn intersection(p: Intersection, _: ()) -> Built {
    let criterion = match p.criterion {
        Criterion::Determinant => tracks::Criterion::Determinant,
        Criterion::Trace => tracks::Criterion::Trace,
    };
    Ok(FusionProduct::Dynamic { rule: TrackRule::Intersection(criterion), feedback: p.feedback })
}

pub(super) fn bar_shalom_campo(p: Dynamic, _: ()) -> Built {
    Ok(FusionProduct::Dynamic { rule: TrackRule::BarShalomCampo, feedback: p.feedback })
}

pub(super) fn equivalent_measurements(p: Dynamic, _: ()) -> Built {
    Ok(FusionProduct::Dynamic { rule: TrackRule::EquivalentMeasurements, feedback: p.feedback })
}
