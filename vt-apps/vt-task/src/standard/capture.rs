//! Cameras and streams that OpenCV reads.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_io::capture::{Capture, Settings, Source};

use super::sensor::{check_rate, conversion};
use crate::quantity::Rate;
use crate::registry::Params;
use crate::roles::{SensorContext, SensorProduct};

/// Parameters of the sensor `opencv`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaptureParams {
    /// Number of a camera, from 0; either this or `source`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<u32>,
    /// Address of a stream, or whatever else OpenCV opens by name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<String>,
    /// Frames per second: a camera is asked for it; a file plays at it, and without it at its own times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Rate>,
    /// Number of frames at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u64>,
}

impl Params for CaptureParams {
    fn check(&self) -> Result<(), ConfigError> {
        if self.device.is_some() == self.source.is_some() {
            let found = if self.source.is_some() { "beside `source`" } else { "missing" };
            return Err(ConfigError::parameter("device", found, "either `device` or `source`"));
        }
        check_rate(self.rate)
    }
}

/// Builds the sensor `opencv`.
pub(super) fn opencv(p: CaptureParams, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let settings = Settings {
        rate: p.rate.map(|r| r.si()),
        frames: p.frames,
        conversion: conversion(context.section.picture),
        size: context.section.camera.as_ref().map(|c| c.size),
    };
    let source = p.source.map_or(Source::Device(p.device.unwrap_or_default()), Source::Name);
    let sensor = Capture::open(context.id, source, settings).map_err(|e| ConfigError::Mismatch {
        found: e.to_string(),
        expected: "a camera or a stream".into(),
    })?;
    Ok(SensorProduct { sensor: Box::new(sensor), truth: None })
}
