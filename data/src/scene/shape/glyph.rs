//! Letters as parts: the outlines of DejaVu Sans Bold, or of its serif.

use serde::{Deserialize, Serialize};
use ttf_parser::{Face, OutlineBuilder};

use super::Shape;
use super::curve::Flatten;
use crate::error::{Error, Result};

/// Straight pieces a curve is cut into: 0.02 mm off at most on a letter of 32 mm.
const PIECES: usize = 12;

/// A font that comes with the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Font {
    /// DejaVu Sans Bold.
    #[default]
    Sans,
    /// DejaVu Serif Bold.
    Serif,
}

/// The outline of a letter of the sans, `height_mm` high and narrowed to `max_width_mm` where it would be wider,
/// centred on its own box.
pub fn glyph(letter: char, height_mm: f64, max_width_mm: f64) -> Result<Shape> {
    glyph_of(Font::Sans, letter, height_mm, max_width_mm)
}

/// The outline of a letter of a font, as [`glyph`].
pub fn glyph_of(font: Font, letter: char, height_mm: f64, max_width_mm: f64) -> Result<Shape> {
    let unknown = |got: String| Error::invalid("part", "a letter of the font", got);
    let face = face(font)?;
    let id = face.glyph_index(letter).ok_or_else(|| unknown(format!("'{letter}'")))?;
    let mut outline = Flatten::new(PIECES);
    face.outline_glyph(id, &mut outline).ok_or_else(|| unknown(format!("'{letter}', which has no outline")))?;
    let shape = Shape { regions: vec![outline.contours] };
    let [x_min, y_min, x_max, y_max] = shape.bounds();
    let (width, height) = (x_max - x_min, y_max - y_min);
    let scale_y = height_mm / height;
    let scale_x = scale_y.min(max_width_mm / width);
    let (x_mid, y_mid) = (0.5 * (x_min + x_max), 0.5 * (y_min + y_max));
    // The font's y points up, the sensor's down.
    Ok(shape.map(|[x, y]| [(x - x_mid) * scale_x, (y_mid - y) * scale_y]))
}

/// The outline of a line of text of size `em_px`, and its width, pixels. It begins at 0, 0,
/// the left end of its base line; y points down. Letters that the font lacks are left out.
pub(crate) fn line_of_text(text: &str, em_px: f64) -> Result<(Shape, f64)> {
    let face = face(Font::Sans)?;
    let scale = em_px / f64::from(face.units_per_em());
    let (mut shape, mut x_px) = (Shape::default(), 0.0);
    for id in text.chars().filter_map(|letter| face.glyph_index(letter)) {
        let mut outline = Flatten::new(PIECES);
        // A blank has no outline.
        face.outline_glyph(id, &mut outline);
        let placed = Shape { regions: vec![outline.contours] }.map(|[x, y]| [x_px + x * scale, -y * scale]);
        shape.regions.extend(placed.regions);
        x_px += f64::from(face.glyph_hor_advance(id).unwrap_or_default()) * scale;
    }
    Ok((shape, x_px))
}

fn face(font: Font) -> Result<Face<'static>> {
    let bytes = match font {
        Font::Sans => dejavu::sans::bold(),
        Font::Serif => dejavu::serif::bold(),
    };
    Face::parse(bytes, 0).map_err(|e| Error::invalid("font", "a TrueType font", e.to_string()))
}

impl OutlineBuilder for Flatten {
    fn move_to(&mut self, x: f32, y: f32) {
        self.start([x, y].map(f64::from));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.line([x, y].map(f64::from));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.quadratic([x1, y1].map(f64::from), [x, y].map(f64::from));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.cubic([x1, y1].map(f64::from), [x2, y2].map(f64::from), [x, y].map(f64::from));
    }

    fn close(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Raster;

    #[test]
    fn letters_have_the_size_asked_for_and_lie_centred() {
        for (font, letter) in ('0'..='9').chain('A'..='Z').flat_map(|c| [(Font::Sans, c), (Font::Serif, c)]) {
            let [x_min, y_min, x_max, y_max] = glyph_of(font, letter, 32.0, 40.0).unwrap().bounds();
            assert!((y_max - y_min - 32.0).abs() < 1e-9 && x_max - x_min <= 40.0 + 1e-9, "{letter}");
            assert!((x_max + x_min).abs() < 1e-9 && (y_max + y_min).abs() < 1e-9, "{letter}");
        }
    }

    #[test]
    fn an_i_with_serifs_is_wider_at_its_ends_than_in_the_middle_and_without_is_not() {
        let width = |font, y_mm: f64| {
            let raster = Raster::coverage(&glyph_of(font, 'I', 12.0, 16.0).unwrap(), 8.0, 0.1);
            let row = ((y_mm + 8.0) / 0.1) as usize;
            raster.values[row * raster.n..(row + 1) * raster.n].iter().sum::<f32>() * 0.1
        };
        assert!((width(Font::Sans, 5.5) - width(Font::Sans, 0.0)).abs() < 0.1);
        assert!(width(Font::Serif, 5.5) > 1.5 * width(Font::Serif, 0.0));
    }

    #[test]
    fn letters_stand_upright_and_keep_their_counters() {
        let raster = Raster::coverage(&glyph('L', 12.0, 16.0).unwrap(), 8.0, 0.1);
        let half = |rows: std::ops::Range<usize>| {
            raster.values[rows.start * raster.n..rows.end * raster.n].iter().sum::<f32>()
        };
        assert!(half(80..160) > 1.3 * half(0..80), "the foot of an L is at the bottom");
        let ring = Raster::coverage(&glyph('O', 12.0, 16.0).unwrap(), 8.0, 0.1);
        assert_eq!(ring.values[80 * ring.n + 80], 0.0);
    }

    #[test]
    fn an_unknown_letter_is_named() {
        assert!(glyph('\u{10FFFF}', 12.0, 16.0).unwrap_err().to_string().contains("letter of the font"));
    }
}
