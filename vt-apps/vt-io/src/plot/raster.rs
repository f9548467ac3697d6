//! A canvas as a place for plots to be drawn on.

use core::convert::Infallible;

use plotters::prelude::DrawingBackend;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind};

use crate::canvas::Canvas;

/// Width and height of a letter in pixels, whatever size is asked for.
const LETTER: i32 = 8;

pub(super) struct Raster<'a> {
    pub(super) canvas: &'a mut Canvas,
}

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

fn size(text: &str) -> (i32, i32) {
    (LETTER * i32::try_from(text.chars().count()).unwrap_or(i32::MAX / LETTER), LETTER)
}

fn real(p: BackendCoord) -> [f64; 2] {
    [f64::from(p.0), f64::from(p.1)]
}

impl DrawingBackend for Raster<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.canvas.picture.dimensions()
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn {
        let (r, g, b) = color.rgb;
        self.canvas.blend(point.0.into(), point.1.into(), [r, g, b], color.alpha);
        Ok(())
    }

    /// Smooth lines instead of stairs.
    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Drawn {
        let color = style.color();
        let (r, g, b) = color.rgb;
        self.canvas.line(real(from), real(to), style.stroke_width().into(), [r, g, b], color.alpha);
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let mut last = None;
        for point in path {
            if let Some(from) = last.replace(point) {
                self.draw_line(from, point, style)?;
            }
        }
        Ok(())
    }

    /// Upright letters of the canvas, placed by the anchor.
    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Drawn {
        let (width, height) = size(text);
        let x = match style.anchor().h_pos {
            HPos::Left => at.0,
            HPos::Right => at.0 - width,
            HPos::Center => at.0 - width / 2,
        };
        let y = match style.anchor().v_pos {
            VPos::Top => at.1,
            VPos::Center => at.1 - height / 2,
            VPos::Bottom => at.1 - height,
        };
        let color = style.color();
        let (r, g, b) = color.rgb;
        if color.alpha > 0.0 {
            self.canvas.text(x.into(), y.into(), text, [r, g, b]);
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        _: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let (width, height) = size(text);
        Ok((width.unsigned_abs(), height.unsigned_abs()))
    }
}
