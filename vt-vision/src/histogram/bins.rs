//! The bin of a pixel.

use image::RgbImage;
use vt_core::batch::vectorized;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

use crate::color::{HueRange, rgb_to_hsv, rows};
use crate::plane::{Plane, area, clip, reserve};
use crate::turns::Turns;

/// More bins along one axis are not told apart from their neighbours by 8 bit.
const MOST: u16 = 128;

/// What becomes of pixels too dark or too pale to have a hue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Achromatic {
    /// They count by hue and saturation as all others.
    AsColor,
    /// They have no bin.
    Ignored,
    /// They count by value, in so many bins after the others.
    ValueBins(u16),
}

/// Layout of a histogram: 10 × 10 bins of hue and saturation and 10 of value by default, 110 in all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BinningParams {
    /// Bins of hue, 1 to 128.
    pub hue: u16,
    /// Bins of saturation, 1 to 128.
    pub saturation: u16,
    /// Pixels without a hue.
    pub achromatic: Achromatic,
    /// A pixel has a hue if its saturation exceeds this, 0 to 1 …
    pub min_saturation: f64,
    /// … and its value exceeds this, 0 to 1.
    pub min_value: f64,
}

impl Default for BinningParams {
    fn default() -> Self {
        Self {
            hue: 10,
            saturation: 10,
            achromatic: Achromatic::ValueBins(10),
            min_saturation: 0.1,
            min_value: 0.2,
        }
    }
}

/// A layout whose parameters were checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Binning {
    params: BinningParams,
    /// `⌊bins · x / range⌋` is `scale · x >> 16` for all bytes.
    scales: [u16; 3],
    /// A pixel has a hue if saturation and value exceed these.
    least: [i16; 2],
}

impl BinningParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Binning, ConfigError> {
        let value = if let Achromatic::ValueBins(n) = self.achromatic { n } else { 1 };
        let keys = ["hue", "saturation", "value"];
        for (key, n) in keys.into_iter().zip([self.hue, self.saturation, value]) {
            if !(1..=MOST).contains(&n) {
                return Err(ConfigError::parameter(key, n, format!("1 to {MOST} bins")));
            }
        }
        for (key, share) in [("min_saturation", self.min_saturation), ("min_value", self.min_value)] {
            if !(0.0..=1.0).contains(&share) {
                return Err(ConfigError::parameter(key, share, "0 to 1"));
            }
        }
        // The quotient rounded up is exact: its excess, below one, times 255 stays below the least gap, 65536 / 256.
        let scale = |n: u16, range: u16| (u32::from(n) << 16).div_ceil(u32::from(range)) as u16;
        let scales =
            [scale(self.hue, HueRange::Half.steps()), scale(self.saturation, 256), scale(value, 256)];
        let least = if self.achromatic == Achromatic::AsColor {
            [-1; 2]
        } else {
            [self.min_saturation, self.min_value].map(|share| (255.0 * share).floor() as i16)
        };
        Ok(Binning { params: self, scales, least })
    }
}

impl Binning {
    /// The parameters.
    pub fn params(&self) -> &BinningParams {
        &self.params
    }

    /// Number of bins. A pixel without a bin has this number.
    pub fn count(&self) -> u16 {
        let extra = if let Achromatic::ValueBins(n) = self.params.achromatic { n } else { 0 };
        self.params.hue * self.params.saturation + extra
    }

    /// Bins of pixels with these hues (0 to 179), saturations and values: row by row of equal hue, then those of value.
    pub fn assign(&self, hue: &[u8], saturation: &[u8], value: &[u8], bins: &mut [u16]) {
        let Self { params, scales: [by_hue, by_saturation, by_value], least } = *self;
        let (wide, first, ignored) =
            (params.saturation, params.hue * params.saturation, params.achromatic == Achromatic::Ignored);
        let by_value = if ignored { 0 } else { by_value };
        vectorized(
            #[inline(always)]
            move || {
                let part = |x: u8, scale: u16| ((u32::from(x) * u32::from(scale)) >> 16) as u16;
                for (((&h, &s), &v), bin) in hue.iter().zip(saturation).zip(value).zip(bins) {
                    let coloured = part(h, by_hue) * wide + part(s, by_saturation);
                    let has_hue = (i16::from(s) > least[0]) & (i16::from(v) > least[1]);
                    *bin = if has_hue { coloured } else { first + part(v, by_value) };
                }
            },
        );
    }

    /// Text that names the layout in a key.
    fn name(&self) -> String {
        let BinningParams { hue, saturation, achromatic, min_saturation, min_value } = self.params;
        let rest = match achromatic {
            Achromatic::AsColor => return format!("{hue}x{saturation}"),
            Achromatic::Ignored => "none".into(),
            Achromatic::ValueBins(n) => n.to_string(),
        };
        format!("{hue}x{saturation}+{rest}/min_saturation={min_saturation}/min_value={min_value}")
    }
}

/// The bins of all pixels of a region.
#[derive(Clone, Debug, Default)]
pub struct ColorBins {
    /// Number of the bin, [`Binning::count`] for a pixel without one.
    pub bins: Plane<u16>,
    /// Hue, saturation and value of one row.
    scratch: Vec<u8>,
}

impl ColorBins {
    /// Finds the bins of `image` inside `roi`, or everywhere.
    pub fn compute(&mut self, image: &RgbImage, roi: Option<Roi>, binning: &Binning) {
        let region = clip(roi, image.dimensions(), 0);
        let width = region.width as usize;
        self.bins.reserve(area(image.dimensions()));
        reserve(&mut self.scratch, 3 * image.width() as usize);
        let bins = self.bins.reshape(region);
        if width == 0 {
            return;
        }
        self.scratch.resize(3 * width, 0);
        let (hue, rest) = self.scratch.split_at_mut(width);
        let (saturation, value) = rest.split_at_mut(width);
        for (rgb, out) in rows(image, region).zip(bins.chunks_exact_mut(width)) {
            rgb_to_hsv(rgb, HueRange::Half, hue, saturation, value);
            binning.assign(hue, saturation, value, out);
        }
    }
}

/// Makes [`ColorBins`] of every colour frame of a sensor, in [`Turns`].
pub struct ColorBinsProcessing {
    key: EvidenceKey,
    binning: Binning,
}

impl ColorBinsProcessing {
    /// Bins of the pictures of `sensor`.
    pub fn new(sensor: SensorId, binning: Binning) -> Self {
        Self { key: Self::key_for(sensor, &binning), binning }
    }

    /// Key under which the [`Turns`] of [`ColorBins`] are found.
    pub fn key_for(sensor: SensorId, binning: &Binning) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("color-bins/{}", binning.name()).into() }
    }
}

impl Processing for ColorBinsProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<Turns<ColorBins>>().turn().compute(frame.rgb()?, roi, &self.binning);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn achromatic() -> impl Strategy<Value = Achromatic> {
        prop_oneof![
            Just(Achromatic::AsColor),
            Just(Achromatic::Ignored),
            (1u16..=MOST).prop_map(Achromatic::ValueBins)
        ]
    }

    proptest! {
        #[test]
        fn a_pixel_is_in_the_bin_of_its_quotients(
            (hue, saturation) in (1u16..=MOST, 1u16..=MOST), achromatic in achromatic(),
            (min_saturation, min_value) in (0.0..=1.0, 0.0..=1.0),
        ) {
            let params = BinningParams { hue, saturation, achromatic, min_saturation, min_value };
            let binning = params.check().unwrap();
            let bytes: Vec<u8> = (0..=255).collect();
            let hues: Vec<u8> = (0..256u32).map(|k| (k * 77 % 180) as u8).collect();
            let values: Vec<u8> = (0..256u32).map(|k| (k * 45 % 256) as u8).collect();
            let mut bins = vec![0; 256];
            binning.assign(&hues, &bytes, &values, &mut bins);
            for k in 0..256 {
                let [h, s, v] = [hues[k], bytes[k], values[k]].map(u32::from);
                let has_hue = f64::from(s) > 255.0 * min_saturation && f64::from(v) > 255.0 * min_value;
                let coloured = h * u32::from(hue) / 180 * u32::from(saturation) + s * u32::from(saturation) / 256;
                let first = u32::from(hue) * u32::from(saturation);
                let expected = match achromatic {
                    _ if has_hue => coloured,
                    Achromatic::AsColor => coloured,
                    Achromatic::Ignored => first,
                    Achromatic::ValueBins(n) => first + v * u32::from(n) / 256,
                };
                prop_assert_eq!(u32::from(bins[k]), expected);
                prop_assert!(bins[k] < binning.count() || achromatic == Achromatic::Ignored && !has_hue);
            }
        }
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let wrong = |change: fn(&mut BinningParams)| {
            let mut params = BinningParams::default();
            change(&mut params);
            params.check().unwrap_err().to_string()
        };
        assert!(wrong(|p| p.hue = 0).contains("hue"));
        assert!(wrong(|p| p.saturation = 129).contains("saturation"));
        assert!(wrong(|p| p.achromatic = Achromatic::ValueBins(0)).contains("value"));
        assert!(wrong(|p| p.min_value = f64::NAN).contains("min_value"));
        assert_eq!(BinningParams::default().check().unwrap().count(), 110);
    }

    #[test]
    fn a_region_has_the_bins_of_the_whole() {
        let image = RgbImage::from_fn(40, 30, |x, y| image::Rgb([6 * x as u8, 8 * y as u8, (x * y) as u8]));
        let binning = BinningParams::default().check().unwrap();
        let (mut whole, mut part) = (ColorBins::default(), ColorBins::default());
        whole.compute(&image, None, &binning);
        let roi = Roi { x: 11, y: 7, width: 13, height: 9 };
        part.compute(&image, Some(roi), &binning);
        for y in roi.y..roi.y + roi.height {
            assert_eq!(part.bins.row(y, roi), whole.bins.row(y, roi));
        }
        part.compute(&image, Some(Roi { x: 40, ..roi }), &binning);
        assert!(part.bins.values().is_empty());
    }
}
