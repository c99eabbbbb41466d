//! Scenes known by name.

use super::{Connectors, Kit, MazeBoards, Parts, Scene, default_clearance, default_fidelity};
use crate::grid::PoseGrid;
use crate::sensor::SensorSpec;
use crate::shape::connector::Connector;
use crate::shape::maze::MazeSpec;

impl Scene {
    /// Names that [`Scene::load`] knows without a file. Those on `-dev` are for tuning; the others are
    /// never trained or tuned on.
    pub const PRESETS: [&str; 6] =
        ["maze", "alphabet-small", "alphabet-large", "alphabet-small-dev", "alphabet-large-dev", "connectors"];

    /// A preset by its name.
    pub fn preset(name: &str) -> Option<Self> {
        let letters = |letters: &str, height_mm, max_width_mm, reach| {
            (Parts::Kit(Kit::of_letters(letters, height_mm, max_width_mm)), Some(reach))
        };
        let (parts, reach) = match name {
            "maze" => {
                let boards = MazeBoards {
                    n_boards: 80,
                    n_held_out: 6,
                    n_pairs: 12_000,
                    gel_length_mm: [0.9, 1.6],
                    spec: MazeSpec::default(),
                };
                (Parts::Maze(boards), None)
            }
            "alphabet-small" => letters("ABCDEFGHIJKL", 12.0, 16.0, PoseGrid::SMALL),
            "alphabet-large" => letters("ABCDEFGHIJKL", 32.0, 40.0, PoseGrid::LARGE),
            "alphabet-small-dev" => letters("MNOPQRSTUVWX", 12.0, 16.0, PoseGrid::SMALL),
            "alphabet-large-dev" => letters("MNOPQRSTUVWX", 32.0, 40.0, PoseGrid::LARGE),
            "connectors" => {
                // The paper tells neither its six connectors nor their poses; these are as small as its letters.
                let names = Connector::ALL.into_iter().filter(|connector| *connector != Connector::Jack);
                let connectors = Some(Connectors { names: names.collect() });
                (Parts::Kit(Kit { connectors, ..Kit::default() }), Some(PoseGrid::SMALL))
            }
            _ => return None,
        };
        Some(Self {
            name: name.into(),
            parts,
            board: None,
            reach,
            clearance_mm: default_clearance(),
            gauge_mm: 0.0,
            fidelity: default_fidelity(),
            sensor: SensorSpec::default(),
        })
    }
}
