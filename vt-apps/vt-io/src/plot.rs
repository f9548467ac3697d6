//! Plots: panels of curves, bands and coloured spans over one axis, as PNG or SVG, without fonts of the system.

mod raster;

use core::fmt::Display;
use std::path::Path;

use image::RgbImage;
use plotters::coord::Shift;
use plotters::prelude::{
    ChartBuilder, Circle, Color, DrawingArea, DrawingAreaErrorKind, DrawingBackend, IntoDrawingArea,
    LineSeries, Polygon, RGBColor, Rectangle, SVGBackend, SeriesLabelPosition, ShapeStyle, TRANSPARENT,
    WHITE,
};
use vt_core::error::DeviceError;
use vt_core::metrics::PoseError;

use crate::canvas::Canvas;
use crate::files::{replace, save_png};
use raster::Raster;

/// A colour, red green blue.
pub type Rgb = [u8; 3];

/// Colours of curves that differ for all kinds of colour vision (M. Okabe, K. Ito, 2008).
pub const CURVES: [Rgb; 4] = [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167]];

/// Larger values are left out of a plot.
const LARGEST: f64 = 1e12;

const WIDTH: u32 = 960;
const PANEL_HEIGHT: u32 = 170;
const FONT: &str = "sans-serif";

/// A curve. Points that are not finite leave gaps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Name for the legend.
    pub name: String,
    /// Colour.
    pub colour: Rgb,
    /// Points from left to right.
    pub points: Vec<[f64; 2]>,
}

/// An area between two curves.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Name for the legend.
    pub name: String,
    /// Colour.
    pub colour: Rgb,
    /// Place, lower and upper value, from left to right.
    pub points: Vec<[f64; 3]>,
}

/// A coloured background between two places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Span {
    /// First and last place.
    pub places: [f64; 2],
    /// Colour.
    pub colour: Rgb,
}

/// Curves over one pair of axes. The vertical axis reaches from 0, or from the lowest value below, to the highest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// What is shown, with its unit.
    pub title: String,
    /// Behind everything.
    pub spans: Vec<Span>,
    /// Behind the curves.
    pub bands: Vec<Band>,
    /// In front.
    pub curves: Vec<Curve>,
}

/// Panels one below the other over the same places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// From top to bottom.
    pub panels: Vec<Panel>,
}

fn fair(v: f64) -> bool {
    v.abs() < LARGEST
}

/// Smallest and largest fair value; `None` without any.
fn extent(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|v| fair(*v)).fold(None, |e, v| match e {
        None => Some([v, v]),
        Some([lo, hi]) => Some([lo.min(v), hi.max(v)]),
    })
}

fn colour(c: Rgb) -> RGBColor {
    RGBColor(c[0], c[1], c[2])
}

type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl Panel {
    fn places(&self) -> impl Iterator<Item = f64> {
        let bands = self.bands.iter().flat_map(|b| b.points.iter().map(|p| p[0]));
        let spans = self.spans.iter().flat_map(|s| s.places);
        self.curves.iter().flat_map(|c| c.points.iter().map(|p| p[0])).chain(bands).chain(spans)
    }

    fn values(&self) -> [f64; 2] {
        let bands = self.bands.iter().flat_map(|b| b.points.iter().flat_map(|p| [p[1], p[2]]));
        let curves = self.curves.iter().flat_map(|c| c.points.iter().map(|p| p[1]));
        let [lo, hi] = extent(curves.chain(bands)).unwrap_or([0.0, 1.0]);
        let lo = lo.min(0.0);
        // Some air above, and never an empty range.
        let air = 0.05 * (hi - lo);
        [if lo < 0.0 { lo - air } else { lo }, (hi + air).max(lo + 1e-6)]
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, [left, right]: [f64; 2]) -> Drawn<B> {
        let [bottom, top] = self.values();
        let mut chart = ChartBuilder::on(area)
            .margin_right(16)
            .margin_top(2)
            .caption(&self.title, (FONT, 13))
            .x_label_area_size(18)
            .y_label_area_size(64)
            .build_cartesian_2d(left..right, bottom..top)?;
        for span in &self.spans {
            let [from, to] = span.places;
            let style = colour(span.colour).mix(0.25).filled();
            chart.draw_series([Rectangle::new([(from, bottom), (to, top)], style)])?;
        }
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(215, 215, 215))
            .x_labels(10)
            .y_labels(5)
            .label_style((FONT, 11))
            // Ticks are multiples of a step, with its rounding errors.
            .x_label_formatter(&|x| format!("{}", (x * 1e9).round() / 1e9))
            .draw()?;
        let mut named = false;
        for band in &self.bands {
            let points: Vec<_> = band.points.iter().filter(|p| p.iter().all(|v| fair(*v))).collect();
            let outline =
                points.iter().map(|p| (p[0], p[1])).chain(points.iter().rev().map(|p| (p[0], p[2])));
            let style: ShapeStyle = colour(band.colour).mix(0.3).filled();
            let drawn = chart.draw_series([Polygon::new(outline.collect::<Vec<_>>(), style)])?;
            if !band.name.is_empty() {
                named = true;
                drawn
                    .label(&band.name)
                    .legend(move |(x, y)| Rectangle::new([(x, y - 4), (x + 14, y + 4)], style));
            }
        }
        for curve in &self.curves {
            let style = colour(curve.colour).stroke_width(1);
            let mut parts = curve.points.split(|p| !p.iter().all(|v| fair(*v))).filter(|p| !p.is_empty());
            // The first part, empty where there is none, carries the name.
            let first = parts.next().unwrap_or(&[]);
            let drawn = chart.draw_series(LineSeries::new(first.iter().map(|p| (p[0], p[1])), style))?;
            if !curve.name.is_empty() {
                named = true;
                let line = move |(x, y)| Rectangle::new([(x, y - 1), (x + 14, y + 1)], style.filled());
                drawn.label(&curve.name).legend(line);
            }
            for part in core::iter::once(first).chain(parts) {
                match part {
                    [p] => drop(chart.draw_series([Circle::new((p[0], p[1]), 2, style.filled())])?),
                    _ => drop(chart.draw_series(LineSeries::new(part.iter().map(|p| (p[0], p[1])), style))?),
                }
            }
        }
        if named {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .label_font((FONT, 13))
                .background_style(WHITE.mix(0.8))
                .draw()?;
        }
        Ok(())
    }
}

impl Figure {
    fn size(&self) -> (u32, u32) {
        (WIDTH, 30 + PANEL_HEIGHT * (self.panels.len() as u32).max(1))
    }

    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Drawn<B> {
        root.fill(&WHITE)?;
        let body = root.titled(&self.title, (FONT, 16))?;
        let [left, right] = extent(self.panels.iter().flat_map(Panel::places)).unwrap_or([0.0, 1.0]);
        let places = [left, right.max(left + 1e-6)];
        for (panel, area) in self.panels.iter().zip(body.split_evenly((self.panels.len().max(1), 1))) {
            panel.draw(&area, places)?;
        }
        root.present()
    }

    /// The figure as a picture; letters are those of [`Canvas`].
    ///
    /// # Errors
    /// A message of the plotting library.
    pub fn picture(&self) -> Result<RgbImage, String> {
        let (width, height) = self.size();
        let mut canvas = Canvas { picture: RgbImage::new(width, height) };
        self.draw(&Raster { canvas: &mut canvas }.into_drawing_area()).map_err(text)?;
        Ok(canvas.picture)
    }

    /// The figure as an SVG text; the viewer brings the font.
    ///
    /// # Errors
    /// A message of the plotting library.
    pub fn svg(&self) -> Result<String, String> {
        let mut out = String::new();
        self.draw(&SVGBackend::with_string(&mut out, self.size()).into_drawing_area()).map_err(text)?;
        Ok(out)
    }

    /// Writes the figure, as SVG when the name ends so, otherwise as PNG; readers see the old file or the new one.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file.
    pub fn save(&self, path: &Path) -> Result<(), DeviceError> {
        let fail = |why: String| DeviceError::new(path.display(), why);
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("svg") => replace(path, self.svg().map_err(fail)?.as_bytes()),
            Some("png") => save_png(path, &self.picture().map_err(fail)?, &mut vec![]),
            _ => Err(fail("expected a name that ends in .png or .svg".into())),
        }
    }
}

fn text(e: impl Display) -> String {
    e.to_string()
}

/// Errors over frames; frames without an estimate are red.
pub fn errors(title: &str, errors: &[(u64, Option<PoseError>)]) -> Figure {
    let missing = errors.iter().filter(|(_, e)| e.is_none()).map(|(k, _)| *k as f64);
    let spans: Vec<Span> =
        missing.map(|k| Span { places: [k - 0.5, k + 0.5], colour: [230, 40, 40] }).collect();
    let panel = |title: &str, value: fn(&PoseError) -> f64| {
        let points = errors.iter().map(|(k, e)| [*k as f64, e.as_ref().map_or(f64::NAN, value)]).collect();
        let curve = Curve { name: String::new(), colour: CURVES[0], points };
        Panel { title: title.into(), spans: spans.clone(), curves: vec![curve], bands: vec![] }
    };
    let panels = vec![
        panel("translation error, mm", |e| 1e3 * e.translation),
        panel("rotation error, deg", |e| e.rotation.to_degrees()),
    ];
    Figure { title: title.into(), panels }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(points: Vec<[f64; 2]>) -> Figure {
        let curve = Curve { name: "curve".into(), colour: [200, 0, 0], points };
        let band =
            Band { name: "band".into(), colour: [0, 0, 200], points: vec![[0.0, 1.0, 2.0], [9.0, 1.0, 3.0]] };
        let span = Span { places: [2.0, 4.0], colour: [0, 200, 0] };
        let panel =
            Panel { title: "speed, m/s".into(), spans: vec![span], bands: vec![band], curves: vec![curve] };
        Figure { title: "A <title> & more".into(), panels: vec![panel.clone(), panel] }
    }

    #[test]
    fn both_forms_show_curve_band_span_and_text() {
        let figure = figure((0..10).map(|k| [f64::from(k), f64::from(k % 3)]).collect());
        let picture = figure.picture().unwrap();
        assert_eq!(picture.dimensions(), (960, 370));
        let count = |f: fn([u8; 3]) -> bool| picture.pixels().filter(|p| f(p.0)).count();
        assert!(count(|[r, g, b]| r > 150 && g < 60 && b < 60) > 300, "the curve");
        assert!(count(|[r, g, b]| b > 200 && r < 200 && g < 200) > 2000, "the band");
        assert!(count(|[r, g, b]| g > 200 && r < 210 && b < 210) > 2000, "the span");
        assert!(count(|[r, g, b]| r < 60 && g < 60 && b < 60) > 300, "letters");
        let svg = figure.svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(svg.contains("speed, m/s") && svg.contains("A &lt;title&gt; &amp; more"), "{svg}");
    }

    #[test]
    fn any_numbers_can_be_plotted() {
        let cases: [Vec<[f64; 2]>; 6] = [
            vec![],
            vec![[3.0, 3.0]],
            vec![[0.0, f64::NAN], [1.0, f64::INFINITY]],
            vec![[0.0, 1e300], [1.0, -1e300], [2.0, 1.0]],
            vec![[0.0, 5.0], [0.0, 5.0]],
            vec![[1e9, 1e-9], [1e9, 2e-9], [1e9 + 1.0, -1e11]],
        ];
        for points in cases {
            let mut bare = figure(points.clone());
            bare.panels.iter_mut().for_each(|p| (p.bands, p.spans) = (vec![], vec![]));
            assert!(bare.picture().is_ok() && bare.svg().is_ok(), "{points:?}");
            assert!(figure(points.clone()).picture().is_ok(), "{points:?}");
        }
        assert!(Figure::default().picture().is_ok());
    }
}
