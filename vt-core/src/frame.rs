//! What a sensor delivers.

#[cfg(feature = "image")]
use std::sync::Arc;

use crate::error::MeasureError;
use crate::time::Timestamp;

/// Number of a sensor within a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SensorId(pub u32);

/// One delivery of one sensor.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Which sensor.
    pub sensor: SensorId,
    /// Number of the frame as in its file name, or counted from 0.
    pub number: u64,
    /// Middle of the exposure.
    pub time: Timestamp,
    /// The data.
    pub payload: Payload,
}

/// Data of a frame. Images are shared, so that a frame is cheap to clone.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Payload {
    /// Numbers of any meaning: range scan, inertial unit, joint encoders.
    Vector(Vec<f64>),
    /// Grey picture, 8 bit.
    #[cfg(feature = "image")]
    Grey(Arc<image::GrayImage>),
    /// Colour picture, 8 bit, sRGB.
    #[cfg(feature = "image")]
    Rgb(Arc<image::RgbImage>),
    /// Depth along the optical axis in metres; 0 where unknown.
    #[cfg(feature = "image")]
    Depth(Arc<image::ImageBuffer<image::Luma<f32>, Vec<f32>>>),
}

impl Payload {
    /// Name of the kind of data, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Vector(_) => "a vector",
            #[cfg(feature = "image")]
            Self::Grey(_) => "a grey picture",
            #[cfg(feature = "image")]
            Self::Rgb(_) => "a colour picture",
            #[cfg(feature = "image")]
            Self::Depth(_) => "a depth picture",
        }
    }
}

impl Payload {
    /// Columns and rows of a picture.
    #[cfg(feature = "image")]
    pub fn size(&self) -> Option<[u32; 2]> {
        match self {
            Self::Vector(_) => None,
            Self::Grey(p) => Some(p.dimensions().into()),
            Self::Rgb(p) => Some(p.dimensions().into()),
            Self::Depth(p) => Some(p.dimensions().into()),
        }
    }
}

impl Frame {
    /// The grey picture, or an error that names what came instead.
    #[cfg(feature = "image")]
    pub fn grey(&self) -> Result<&image::GrayImage, MeasureError> {
        match &self.payload {
            Payload::Grey(picture) => Ok(picture),
            _ => Err(self.unexpected("a grey picture")),
        }
    }

    /// The colour picture, or an error that names what came instead.
    #[cfg(feature = "image")]
    pub fn rgb(&self) -> Result<&image::RgbImage, MeasureError> {
        match &self.payload {
            Payload::Rgb(picture) => Ok(picture),
            _ => Err(self.unexpected("a colour picture")),
        }
    }

    /// The numbers, or an error that names what came instead.
    pub fn vector(&self) -> Result<&[f64], MeasureError> {
        match &self.payload {
            Payload::Vector(v) => Ok(v),
            #[cfg(feature = "image")]
            _ => Err(self.unexpected("a vector")),
        }
    }

    #[cfg(feature = "image")]
    fn unexpected(&self, expected: &str) -> MeasureError {
        MeasureError::Payload {
            sensor: self.sensor.0,
            found: self.payload.kind().into(),
            expected: expected.into(),
        }
    }
}

/// A rectangle of pixels: columns `x .. x + width`, rows `y .. y + height`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Roi {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

impl Roi {
    /// The smallest rectangle that holds both.
    pub fn union(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        Self { x, y, width: right - x, height: bottom - y }
    }
}
