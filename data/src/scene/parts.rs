//! The parts of a scene: letters, connectors, simple bodies, random outlines, MAZE parts, the user's own files, or MAZE
//! boards.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::part::Part;
use super::{MazeBoards, MazeParts};
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::scene::shape::connector::Connector;
use crate::scene::shape::file::{self, FileScale, ending};
use crate::scene::shape::glyph::{Font, glyph_of};
use crate::scene::shape::heights::GreyScale;
use crate::scene::shape::{Relief, Shape, Solid, outline};
use crate::text::printable::is_printable;

/// The parts of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Declared", into = "Declared")]
pub enum Parts {
    /// Parts that are touched one by one at the poses of the scene's reach.
    Kit(Kit),
    /// Random boards to train on, with pairs of touches all over them.
    Maze(MazeBoards),
}

/// Parts of several kinds, in this order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kit {
    /// Letters, one part each.
    pub letters: Option<Letters>,
    /// Connectors, one part each.
    pub connectors: Option<Connectors>,
    /// Balls, cylinders, rings and cuboids, one part each.
    pub solids: Option<Solids>,
    /// Random closed outlines, one part each.
    pub outlines: Option<Outlines>,
    /// Crops of MAZE boards, islands and outlines with rims, shells and rounded edges, one part each.
    pub maze_parts: Option<MazeParts>,
    /// The user's own parts.
    pub files: Vec<PartFile>,
}

/// Letters, digits or signs of one size and font.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Letters {
    /// The letters, each once.
    pub letters: String,
    /// Their font; a heavy sans without it.
    #[serde(default, skip_serializing_if = "is_default")]
    pub font: Font,
    /// Height of a letter, mm.
    pub height_mm: f64,
    /// Width a letter is narrowed to where it would be wider, mm.
    pub max_width_mm: f64,
}

fn is_default(font: &Font) -> bool {
    *font == Font::default()
}

/// Connectors; plug and receptacle have their own dimensions, without the scene's clearance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Connectors {
    /// The connectors, each once.
    pub names: Vec<Connector>,
}

/// Simple bodies by name and size: `ball:4.7`, `cylinder:6`, `ring:8:5`, `cuboid:10x10`, see [`Solid`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solids {
    /// The bodies, each once. A ball's hole is round, as a cylinder's is.
    pub names: Vec<Solid>,
}

/// Random closed outlines: blobs, polygons, stars, gears and notched rings in turn, see [`outline`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outlines {
    /// How many.
    pub n: usize,
    /// What draws them.
    pub seed: u64,
    /// Least and greatest length of the longer side, mm.
    pub size_mm: [f64; 2],
}

/// The most parts of a scene: what is known of a part before it is touched takes memory, and once it was touched about
/// a megabyte for each of its sides.
pub(super) const MOST_PARTS: usize = 10_000;

/// A part from the user's own files: an outline (`svg`), heights (`png`, `npy`) or a mesh (`stl`), each centred
/// on its own box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartFile {
    /// Name of the part.
    pub name: String,
    /// The raised part; in a scene file its path starts at the file's folder.
    pub peg: PathBuf,
    /// The opening (`svg`), or the surface of the plate with its pockets; without it, a plate with a through
    /// hole that is wider than the peg's outline by the scene's clearance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hole: Option<PathBuf>,
    /// Size of a pixel of a `png` or `npy` in x and y, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mm_per_px: Option<[f64; 2]>,
    /// Height from one grey level of a `png` to the next, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mm_per_level: Option<f64>,
    /// Height from black to white of a `png`, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_scale_mm: Option<f64>,
}

/// Parts as a scene file has them.
#[derive(Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Declared {
    #[serde(skip_serializing_if = "Option::is_none")]
    letters: Option<Letters>,
    #[serde(skip_serializing_if = "Option::is_none")]
    connectors: Option<Connectors>,
    #[serde(skip_serializing_if = "Option::is_none")]
    solids: Option<Solids>,
    #[serde(skip_serializing_if = "Option::is_none")]
    outlines: Option<Outlines>,
    #[serde(skip_serializing_if = "Option::is_none")]
    maze_parts: Option<MazeParts>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    files: Vec<PartFile>,
    #[serde(skip_serializing_if = "Option::is_none")]
    maze: Option<MazeBoards>,
}

impl TryFrom<Declared> for Parts {
    type Error = Error;

    fn try_from(declared: Declared) -> Result<Self> {
        let Declared { letters, connectors, solids, outlines, maze_parts, files, maze } = declared;
        let kit = Kit { letters, connectors, solids, outlines, maze_parts, files };
        match maze {
            None => Ok(Self::Kit(kit)),
            Some(boards) if kit == Kit::default() => Ok(Self::Maze(boards)),
            Some(_) => Err(Error::invalid("parts", "either maze or other parts", "both")),
        }
    }
}

impl From<Parts> for Declared {
    fn from(parts: Parts) -> Self {
        match parts {
            Parts::Kit(Kit { letters, connectors, solids, outlines, maze_parts, files }) => {
                Self { letters, connectors, solids, outlines, maze_parts, files, maze: None }
            }
            Parts::Maze(boards) => Self { maze: Some(boards), ..Self::default() },
        }
    }
}

/// Where one part of a kit comes from.
#[derive(Clone, Copy)]
enum Origin<'a> {
    Letter(char, &'a Letters),
    Connector(Connector),
    Solid(Solid),
    Outline(usize, Outlines),
    MazePart(usize, MazeParts),
    File(usize, &'a PartFile),
}

impl Origin<'_> {
    /// The part that comes from it.
    fn part(self, clearance_mm: f64) -> Result<Part> {
        match self {
            Origin::Letter(letter, Letters { font, height_mm, max_width_mm, .. }) => {
                let outline = glyph_of(*font, letter, *height_mm, *max_width_mm)?;
                Ok(Part::extruded(outline.clone(), Relief::peg(outline), clearance_mm))
            }
            Origin::Connector(connector) => Ok(Part {
                outline: Shape { regions: vec![vec![connector.outline()]] },
                taken: Shape { regions: vec![vec![connector.body()]] },
                clearance_mm: 0.0,
                stands: true,
                peg: connector.plug()?,
                hole: connector.receptacle(),
            }),
            Origin::Solid(solid) => {
                Ok(Part::extruded(solid.outline(), solid.relief(Side::Peg, clearance_mm)?, clearance_mm))
            }
            Origin::Outline(index, Outlines { seed, size_mm, .. }) => {
                let outline = outline::outline(seed, index, size_mm);
                Ok(Part::extruded(outline.clone(), Relief::peg(outline), clearance_mm))
            }
            Origin::MazePart(index, parts) => parts.part(index, clearance_mm),
            Origin::File(i, file) => file.part(&format!("parts.files[{i}]"), clearance_mm),
        }
    }
}

impl Kit {
    /// A kit of letters alone.
    pub fn of_letters(letters: &str, height_mm: f64, max_width_mm: f64) -> Self {
        let letters = Letters { letters: letters.into(), font: Font::Sans, height_mm, max_width_mm };
        Self { letters: Some(letters), ..Self::default() }
    }

    fn origins(&self) -> impl Iterator<Item = Origin<'_>> {
        let letters = self.letters.iter().flat_map(|of| of.letters.chars().map(move |c| Origin::Letter(c, of)));
        let connectors = self.connectors.iter().flat_map(|of| of.names.iter().map(|name| Origin::Connector(*name)));
        let solids = self.solids.iter().flat_map(|of| of.names.iter().map(|solid| Origin::Solid(*solid)));
        let outlines = self.outlines.iter().flat_map(|of| (0..of.n).map(move |index| Origin::Outline(index, *of)));
        let maze_parts =
            self.maze_parts.iter().flat_map(|of| of.range().map(move |index| Origin::MazePart(index, *of)));
        let files = self.files.iter().enumerate().map(|(i, file)| Origin::File(i, file));
        letters.chain(connectors).chain(solids).chain(outlines).chain(maze_parts).chain(files)
    }

    /// Names of the parts.
    pub(super) fn names(&self) -> Vec<String> {
        let name = |origin| match origin {
            Origin::Letter(letter, _) => letter.to_string(),
            Origin::Connector(connector) => connector.name().to_owned(),
            Origin::Solid(solid) => solid.to_string(),
            Origin::Outline(index, _) => outline::name(index),
            Origin::MazePart(index, parts) => parts.name(index),
            Origin::File(_, file) => file.name.clone(),
        };
        self.origins().map(name).collect()
    }

    /// Number of parts.
    pub(super) fn n_parts(&self) -> usize {
        self.origins().count()
    }

    /// One part; reads its files. `clearance_mm` is by how much a hole is wider than its peg on every side.
    pub(super) fn part(&self, part: usize, clearance_mm: f64) -> Result<Part> {
        match self.origins().nth(part) {
            Some(origin) => origin.part(clearance_mm),
            None => Err(Error::invalid("part", "a part of the scene", part.to_string())),
        }
    }

    /// All parts, in order; reads their files.
    pub(super) fn parts(&self, clearance_mm: f64) -> Result<Vec<Part>> {
        self.origins().map(|origin| origin.part(clearance_mm)).collect()
    }

    /// Refuses a kit whose parts cannot be made, naming the field.
    pub(super) fn validate(&self) -> Result<()> {
        if let Some(letters) = &self.letters {
            letters.validate()?;
        }
        if let Some(outlines) = &self.outlines {
            outlines.validate()?;
        }
        if let Some(parts) = &self.maze_parts {
            parts.validate()?;
        }
        let (names, mut known) = (self.names(), HashSet::new());
        if names.is_empty() {
            return Err(Error::invalid(
                "parts",
                "at least one letter, connector, solid, outline, MAZE part or file",
                "none",
            ));
        }
        for name in &names {
            if name.trim().is_empty() || !is_printable(name) {
                return Err(Error::invalid("parts", "a name for each part", format!("{name:?}")));
            }
            if !known.insert(name) {
                return Err(Error::invalid("parts", "each part's name once", format!("'{name}' twice")));
            }
        }
        self.files.iter().enumerate().try_for_each(|(i, file)| file.validate(&format!("parts.files[{i}]")))
    }

    /// Has the paths of files start at `folder`.
    pub(super) fn start_at(&mut self, folder: &Path) {
        let files = self.files.iter_mut();
        files.flat_map(|file| std::iter::once(&mut file.peg).chain(&mut file.hole)).for_each(|path| {
            *path = folder.join(&*path);
        });
    }
}

impl Letters {
    fn validate(&self) -> Result<()> {
        let sizes = [("height_mm", self.height_mm), ("max_width_mm", self.max_width_mm)];
        if let Some((field, value)) = sizes.into_iter().find(|(_, v)| !(v.is_finite() && *v > 0.0 && *v <= 200.0)) {
            return Err(Error::invalid(format!("parts.letters.{field}"), "0 to 200 mm", value.to_string()));
        }
        for letter in self.letters.chars() {
            glyph_of(self.font, letter, self.height_mm, self.max_width_mm)
                .map_err(|e| e.within("parts.letters.letters"))?;
        }
        Ok(())
    }
}

impl Outlines {
    fn validate(&self) -> Result<()> {
        if !(1..=MOST_PARTS).contains(&self.n) {
            return Err(Error::invalid("parts.outlines.n", format!("1 to {MOST_PARTS}"), self.n.to_string()));
        }
        let [least, most] = self.size_mm;
        if !(least >= 1.0 && most >= least && most <= 200.0) {
            let got = format!("{least} to {most}");
            return Err(Error::invalid("parts.outlines.size_mm", "1 to 200 mm, in order", got));
        }
        Ok(())
    }
}

impl PartFile {
    fn validate(&self, field: &str) -> Result<()> {
        let has = |endings: &[&str]| {
            let fits = |path: &PathBuf| endings.contains(&ending(path).as_str());
            fits(&self.peg) || self.hole.as_ref().is_some_and(fits)
        };
        let unused = |name: &str, endings: &str| {
            Err(Error::invalid(format!("{field}.{name}"), format!("a {endings} file to use it on"), "none"))
        };
        if self.mm_per_px.is_some() && !has(&["png", "npy"]) {
            return unused("mm_per_px", "png or npy");
        }
        if (self.mm_per_level.is_some() || self.full_scale_mm.is_some()) && !has(&["png"]) {
            return unused("mm_per_level, full_scale_mm", "png");
        }
        Ok(())
    }

    fn part(&self, field: &str, clearance_mm: f64) -> Result<Part> {
        let grey = match (self.mm_per_level, self.full_scale_mm) {
            (None, None) => None,
            (Some(mm), None) => Some(GreyScale::MmPerLevel(mm)),
            (None, Some(mm)) => Some(GreyScale::FullScaleMm(mm)),
            (Some(_), Some(_)) => {
                return Err(Error::invalid(field, "mm_per_level or full_scale_mm", "both"));
            }
        };
        let scale = FileScale { mm_per_px: self.mm_per_px, grey };
        let peg = file::read(&self.peg, &scale).map_err(|e| e.within(format!("{field}.peg")))?;
        let outline = peg.outline();
        let Some(hole) = &self.hole else { return Ok(Part::extruded(outline, peg.peg(), clearance_mm)) };
        let hole = file::read(hole, &scale).map_err(|e| e.within(format!("{field}.hole")))?;
        let taken = hole.opening();
        Ok(Part { outline, taken, clearance_mm: 0.0, stands: false, peg: peg.peg(), hole: hole.hole() })
    }
}
