//! Physical quantities that carry their unit in the text: `"25 Hz"`, `"20 mm"`, `"5 deg"`.
//!
//! A quantity keeps the number and the unit as they were written, so that printing a task changes nothing;
//! [`Quantity::si`] gives the value for computing.

use core::fmt;
use core::marker::PhantomData;
use core::ops::RangeInclusive;
use std::borrow::Cow;

use serde::de::{Deserialize, Deserializer, Error, Expected, Unexpected, Visitor};
use serde::ser::{Serialize, Serializer};

use crate::nearest::nearest;

/// Sizes in SI units that products of several quantities survive.
const SIZES: RangeInclusive<f64> = 1e-15..=1e15;

const DEGREE: f64 = core::f64::consts::PI / 180.0;

/// A physical dimension and the units in which it can be written.
pub trait Dimension: 'static {
    /// What it is, with its article: `"a length"`.
    const NAME: &'static str;
    /// Units and their size in SI units; the first is the SI unit itself, but for parts of a whole.
    const UNITS: &'static [(&'static str, f64)];
    /// A good value, for messages.
    const EXAMPLE: &'static str;
}

/// A finite number with a unit of the dimension `D`.
pub struct Quantity<D: Dimension> {
    number: f64,
    unit: (&'static str, f64),
    dimension: PhantomData<fn() -> D>,
}

macro_rules! dimensions {
    ($($(#[$doc:meta])* $alias:ident, $tag:ident, $name:literal, $example:literal, [$($unit:literal = $size:expr),+];)+) => {$(
        $(#[$doc])*
        pub type $alias = Quantity<dimension::$tag>;
    )+
    /// The dimensions of the quantities of this module.
    pub mod dimension {
        use super::{DEGREE, Dimension};
        $(
            $(#[$doc])*
            pub enum $tag {}
            impl Dimension for $tag {
                const NAME: &'static str = $name;
                const UNITS: &'static [(&'static str, f64)] = &[$(($unit, $size)),+];
                const EXAMPLE: &'static str = $example;
            }
        )+
    }};
}

dimensions! {
    /// A length; SI unit metre.
    Length, LengthTag, "a length", "20 mm", ["m" = 1.0, "cm" = 0.01, "mm" = 1e-3, "um" = 1e-6, "in" = 0.0254];
    /// An angle; SI unit radian.
    Angle, AngleTag, "an angle", "5 deg", ["rad" = 1.0, "deg" = DEGREE, "mrad" = 1e-3];
    /// A rate; SI unit hertz.
    Rate, RateTag, "a rate", "25 Hz", ["Hz" = 1.0, "kHz" = 1e3, "fps" = 1.0];
    /// A span of time; SI unit second.
    Span, SpanTag, "a span of time", "40 ms", ["s" = 1.0, "ms" = 1e-3, "us" = 1e-6, "ns" = 1e-9];
    /// A length in the picture, in pixels.
    Pixels, PixelsTag, "a number of pixels", "8 px", ["px" = 1.0];
    /// A speed; SI unit metre per second.
    Speed, SpeedTag, "a speed", "0.5 m/s", ["m/s" = 1.0, "cm/s" = 0.01, "mm/s" = 1e-3];
    /// An angular speed; SI unit radian per second.
    AngularSpeed, AngularSpeedTag, "an angular speed", "30 deg/s", ["rad/s" = 1.0, "deg/s" = DEGREE];
    /// An acceleration; SI unit metre per second squared.
    Acceleration, AccelerationTag, "an acceleration", "2 m/s^2", ["m/s^2" = 1.0, "mm/s^2" = 1e-3];
    /// An angular acceleration; SI unit radian per second squared.
    AngularAcceleration, AngularAccelerationTag, "an angular acceleration", "90 deg/s^2",
        ["rad/s^2" = 1.0, "deg/s^2" = DEGREE];
    /// Root of a diffusion of position: deviation after one second of a random walk.
    Diffusion, DiffusionTag, "a diffusion of position", "20 mm/s^0.5",
        ["m/s^0.5" = 1.0, "cm/s^0.5" = 0.01, "mm/s^0.5" = 1e-3];
    /// Root of a diffusion of orientation.
    AngularDiffusion, AngularDiffusionTag, "a diffusion of orientation", "5 deg/s^0.5",
        ["rad/s^0.5" = 1.0, "deg/s^0.5" = DEGREE];
    /// Root of a diffusion of velocity: white acceleration.
    SpeedDiffusion, SpeedDiffusionTag, "a diffusion of velocity", "0.5 m/s^1.5",
        ["m/s^1.5" = 1.0, "cm/s^1.5" = 0.01, "mm/s^1.5" = 1e-3];
    /// Root of a diffusion of angular velocity.
    AngularSpeedDiffusion, AngularSpeedDiffusionTag, "a diffusion of angular velocity", "60 deg/s^1.5",
        ["rad/s^1.5" = 1.0, "deg/s^1.5" = DEGREE];
    /// Root of a diffusion of acceleration: white jerk.
    AccelerationDiffusion, AccelerationDiffusionTag, "a diffusion of acceleration", "2 m/s^2.5",
        ["m/s^2.5" = 1.0, "mm/s^2.5" = 1e-3];
    /// Root of a diffusion of angular acceleration.
    AngularAccelerationDiffusion, AngularAccelerationDiffusionTag, "a diffusion of angular acceleration",
        "90 deg/s^2.5", ["rad/s^2.5" = 1.0, "deg/s^2.5" = DEGREE];
    /// A speed in the picture, in pixels per second.
    PixelSpeed, PixelSpeedTag, "a speed in the picture", "40 px/s", ["px/s" = 1.0];
    /// Root of a diffusion of position in the picture.
    PixelDiffusion, PixelDiffusionTag, "a diffusion of position in the picture", "20 px/s^0.5", ["px/s^0.5" = 1.0];
    /// Root of a diffusion of velocity in the picture.
    PixelSpeedDiffusion, PixelSpeedDiffusionTag, "a diffusion of velocity in the picture", "60 px/s^1.5",
        ["px/s^1.5" = 1.0];
    /// A part of a whole, such as a change of scale.
    Share, ShareTag, "a share", "5 %", ["%" = 0.01];
    /// A rate of relative change.
    ShareSpeed, ShareSpeedTag, "a rate of change", "10 %/s", ["%/s" = 0.01];
    /// Root of a diffusion of scale.
    ShareDiffusion, ShareDiffusionTag, "a diffusion of scale", "5 %/s^0.5", ["%/s^0.5" = 0.01];
    /// Root of a diffusion of a rate of relative change.
    ShareSpeedDiffusion, ShareSpeedDiffusionTag, "a diffusion of a rate of change", "10 %/s^1.5", ["%/s^1.5" = 0.01];
}

impl<D: Dimension> Quantity<D> {
    /// The quantity `number unit`; `None` when the dimension has no such unit or the number is not finite.
    pub fn new(number: f64, unit: &str) -> Option<Self> {
        let unit = *D::UNITS.iter().find(|(name, _)| *name == unit)?;
        number.is_finite().then_some(Self { number, unit, dimension: PhantomData })
    }

    /// The value in SI units (pixels for [`Pixels`]).
    pub fn si(self) -> f64 {
        self.number * self.unit.1
    }

    /// Reads `"20 mm"`; the error says what was expected.
    ///
    /// # Errors
    /// [`Wanted`] when the number or the unit is wrong.
    pub fn parse(text: &str) -> Result<Self, Wanted> {
        let text = text.trim();
        let split = text.find(char::is_whitespace).unwrap_or_else(|| number_length(text));
        let (number, unit) = (&text[..split], text[split..].trim());
        let wanted = |hint| Wanted { description: Self::description(), hint };
        let Ok(value) = number.parse::<f64>() else { return Err(wanted(None)) };
        if let Some((name, size)) = D::UNITS.iter().find(|u| u.0 == unit)
            && value.is_finite()
            && value != 0.0
            && !SIZES.contains(&(value * size).abs())
        {
            let sizes = format!("{:e} to {:e} {}", SIZES.start(), SIZES.end(), D::UNITS[0].0);
            return Err(Wanted {
                description: format!("{}, 0 or of {sizes}, not {number} {name}", D::NAME),
                hint: None,
            });
        }
        Self::new(value, unit).ok_or_else(|| {
            let near = nearest(unit, D::UNITS.iter().map(|u| u.0)).filter(|_| !unit.is_empty());
            wanted(near.map(|u| format!("{number} {u}")))
        })
    }

    fn description() -> String {
        let units: Vec<_> = D::UNITS.iter().map(|u| u.0).collect();
        format!("{} with a unit ({}), such as \"{}\"", D::NAME, units.join(", "), D::EXAMPLE)
    }
}

/// Length of the number at the start of a text without white space.
fn number_length(text: &str) -> usize {
    let b = text.as_bytes();
    (0..b.len())
        .find(|&k| {
            let exponent = matches!(b[k], b'e' | b'E')
                && b.get(k + 1).is_some_and(|c| c.is_ascii_digit() || matches!(c, b'+' | b'-'));
            !(b[k].is_ascii_digit() || matches!(b[k], b'+' | b'-' | b'.') || exponent)
        })
        .unwrap_or(b.len())
}

/// What a quantity should have looked like.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// Dimension, units and an example.
    pub description: String,
    /// The text that was probably meant.
    pub hint: Option<String>,
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.description)?;
        self.hint.as_ref().map_or(Ok(()), |h| write!(f, "; nearest: \"{h}\""))
    }
}

impl Expected for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl<D: Dimension> Clone for Quantity<D> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D: Dimension> Copy for Quantity<D> {}

/// Zero in SI units.
impl<D: Dimension> Default for Quantity<D> {
    fn default() -> Self {
        Self { number: 0.0, unit: D::UNITS[0], dimension: PhantomData }
    }
}

impl<D: Dimension> PartialEq for Quantity<D> {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number && self.unit.0 == other.unit.0
    }
}

impl<D: Dimension> fmt::Display for Quantity<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.number, self.unit.0)
    }
}

impl<D: Dimension> fmt::Debug for Quantity<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl<D: Dimension> Serialize for Quantity<D> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de, D: Dimension> Deserialize<'de> for Quantity<D> {
    fn deserialize<R: Deserializer<'de>>(deserializer: R) -> Result<Self, R::Error> {
        struct Text<D>(PhantomData<fn() -> D>);
        impl<D: Dimension> Visitor<'_> for Text<D> {
            type Value = Quantity<D>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&Quantity::<D>::description())
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<Quantity<D>, E> {
                Quantity::parse(text).map_err(|w| E::invalid_value(Unexpected::Str(text), &w))
            }
        }
        deserializer.deserialize_str(Text(PhantomData))
    }
}

impl<D: Dimension> schemars::JsonSchema for Quantity<D> {
    fn schema_name() -> Cow<'static, str> {
        let words = D::NAME.split(' ').skip(1);
        words.map(|w| w[..1].to_uppercase() + &w[1..]).collect::<String>().into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let units: Vec<_> = D::UNITS.iter().map(|u| u.0.replace('^', "\\^").replace('.', "\\.")).collect();
        schemars::json_schema!({
            "type": "string",
            "description": Self::description(),
            "pattern": format!("^[-+0-9.eE]+ *({})$", units.join("|")),
            "examples": [D::EXAMPLE],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_converted_to_si() {
        assert_eq!(Length::parse("20 mm").unwrap().si(), 0.02);
        assert_eq!(Rate::parse("25Hz").unwrap().si(), 25.0);
        assert_eq!(Length::parse("1e-3m").unwrap().si(), 1e-3);
        assert!((Angle::parse("180 deg").unwrap().si() - core::f64::consts::PI).abs() < 1e-15);
        assert_eq!(SpeedDiffusion::parse("0.5 m/s^1.5").unwrap().si(), 0.5);
    }

    #[test]
    fn wrong_units_are_named() {
        let e = Rate::parse("25 hz").unwrap_err();
        assert_eq!(e.hint.as_deref(), Some("25 Hz"));
        assert!(e.description.contains("a rate") && e.description.contains("kHz"));
        for bad in ["20", "mm", "", "20 kg", "NaN mm", "inf m", "1e999 m", "2 0 mm"] {
            assert!(Length::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn text_comes_back_as_written() {
        for text in ["20 mm", "0.1 m", "-3.5 deg"] {
            let shown =
                Length::parse(text).map(|q| q.to_string()).or(Angle::parse(text).map(|q| q.to_string()));
            assert_eq!(shown.unwrap(), text);
        }
    }
}
