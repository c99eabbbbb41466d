//! Parts from the user's own files: outlines, height maps, meshes.

use std::path::Path;

use super::heights::{self, GreyScale};
use super::{HeightMap, Layer, Relief, Shape, level_line, stl, svg};
use crate::error::{Error, Result};

/// Side of a pixel of a mesh's height map, mm: half a cell of the gel.
pub const STL_CELL_MM: f64 = 0.05;

/// A peg reaches into its hole where it rises to within this of its top, mm.
const REACH_MM: f32 = 1.0;

/// What a hole's own map must drop to be open, mm.
const OPENING_MM: f32 = 0.05;

/// What a file of heights does not say itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FileScale {
    /// Size of a pixel of a PNG or npy in x and y, mm.
    pub mm_per_px: Option<[f64; 2]>,
    /// What the grey levels of a PNG are worth.
    pub grey: Option<GreyScale>,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Drawn {
    /// A flat outline (SVG).
    Outline(Shape),
    /// Heights (PNG, npy, STL).
    Heights(HeightMap),
}

/// Reads a part by its file's ending: `svg`, `png`, `npy` or `stl`. Fails with the file's name where it is of
/// another kind, its scale is missing, or it cannot be read.
pub fn read(path: &Path, scale: &FileScale) -> Result<Drawn> {
    let missing =
        |field: &str, expected: &str| Error::invalid(format!("{}: {field}", path.display()), expected, "none");
    let ending = ending(path);
    let mm_per_px = || scale.mm_per_px.ok_or_else(|| missing("mm_per_px", "the size of a pixel in x and y, mm"));
    match ending.as_str() {
        "svg" => Ok(Drawn::Outline(svg::outline(path)?)),
        "stl" => Ok(Drawn::Heights(stl::height_map(path, STL_CELL_MM)?)),
        "npy" => Ok(Drawn::Heights(heights::from_npy(path, mm_per_px()?)?)),
        "png" => {
            let grey = scale.grey.ok_or_else(|| missing("full_scale_mm", "it, or in a scene mm_per_level"))?;
            Ok(Drawn::Heights(heights::from_png(path, mm_per_px()?, grey)?))
        }
        _ => Err(Error::invalid(path.display().to_string(), "a file ending in svg, png, npy or stl", ending)),
    }
}

/// A file's ending in small letters.
pub fn ending(path: &Path) -> String {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase()
}

impl Drawn {
    /// The outline of a peg's face, or of what rises to within 1 mm of its top.
    pub fn outline(&self) -> Shape {
        match self {
            Self::Outline(shape) => shape.clone(),
            Self::Heights(map) => level_line::outline(map, REACH_MM),
        }
    }

    /// The outline of a hole's opening: as drawn, or where its plate drops by 0.05 mm.
    pub fn opening(&self) -> Shape {
        match self {
            Self::Outline(shape) => shape.clone(),
            Self::Heights(map) => {
                let mut opening = level_line::outline(map, OPENING_MM);
                // Within the map's edge all is open that the plate does not cover.
                let edge = super::relief::rectangle(map.bounds()).regions.into_iter().flatten();
                opening.regions = vec![edge.chain(opening.regions.into_iter().flatten()).collect()];
                opening
            }
        }
    }

    /// As a peg: what is drawn is raised.
    pub fn peg(self) -> Relief {
        match self {
            Self::Outline(shape) => Relief::peg(shape),
            Self::Heights(map) => Relief { layers: vec![Layer::Heights(map)] },
        }
    }

    /// As a hole: what is drawn is open, or the plate is as measured and continues round the map.
    pub fn hole(self) -> Relief {
        match self {
            Self::Outline(shape) => Relief::hole(shape, 0.0),
            Self::Heights(map) => Relief::plate(map),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Raster;

    /// A plate of 6 x 6 mm with a pocket of 2 x 2 mm, 3 mm deep, in its middle.
    fn pocket() -> HeightMap {
        let is_pocket = |i: usize| (20..40).contains(&(i % 60)) && (20..40).contains(&(i / 60));
        let heights: Vec<f32> = (0..3_600).map(|i| if is_pocket(i) { -3.0 } else { 0.0 }).collect();
        HeightMap::new([60, 60], [0.1, 0.1], &heights).unwrap()
    }

    #[test]
    fn the_opening_of_a_measured_plate_is_its_pocket() {
        let opening = Raster::coverage(&Drawn::Heights(pocket()).opening(), 4.0, 0.05);
        let area: f32 = opening.values.iter().sum::<f32>() * 0.05 * 0.05;
        // At 0.05 of 3 mm the line is nearly a pixel outside the lowest pixels' centres: 2.1 mm a side.
        assert!((area - 2.1 * 2.1).abs() < 0.15, "{area}");
    }

    #[test]
    fn a_scale_is_asked_for_where_it_is_needed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        image::GrayImage::new(4, 4).save(at("map.png")).unwrap();
        let (sized, grey) = (Some([0.1, 0.1]), Some(GreyScale::FullScaleMm(2.0)));
        for (name, mm_per_px, grey, named) in [
            ("map.png", None, grey, "map.png: mm_per_px"),
            ("map.png", sized, None, "map.png: full_scale_mm"),
            ("map.npy", None, None, "map.npy: mm_per_px"),
            ("map.step", None, None, "map.step"),
        ] {
            let error = read(&at(name), &FileScale { mm_per_px, grey }).unwrap_err().to_string();
            assert!(error.contains(named) && !error.contains('\n'), "{error}");
        }
        assert!(read(&at("map.png"), &FileScale { mm_per_px: sized, grey }).is_ok());
    }
}
