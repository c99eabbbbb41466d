//! The mosaics of a scene's parts: their pegs, and their holes, touched all over, and the maps of these touches stitched.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use tactile_data::dataset::generate::{Places, plan, render};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Background, TactileImage};
use tactile_data::pose::grid::PoseGrid;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;

use super::expected::expected_of_scene;
use crate::bank::Bank;
use crate::bank::views::Views;
use crate::embedding::threads;
use crate::error::{Error, Result};
use crate::maps::mosaic::{Mosaics, Stitcher};
use crate::maps::{MapDrawer, Maps};

/// Parts are touched at most so far apart, mm and degrees: each place some twenty times, from all sides.
const STEPS: [f64; 2] = [4.0, 45.0];

/// Sets these touches apart from a bank's.
const MOSAICS: u64 = 0x6d6f_7361_6963_0000;

/// A bank of a scene's parts, with a map of each and what these networks say of touches that were made on it. `progress`: touches done, and
/// all.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames cannot be drawn; a bank of other parts.
pub fn with_maps_of_scene(
    bank: Bank,
    maps: &Maps,
    (scene, views): (&Scene, Views),
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Bank> {
    let mosaics = mosaics_of_scene(maps.drawer(), (scene, views), seed, progress)?;
    let Some(verifier) = maps.verifier() else { return bank.with_mosaics(mosaics) };
    let expected = expected_of_scene(maps.drawer(), verifier, &mosaics, scene, seed)?;
    bank.with_mosaics(mosaics)?.with_expected(expected)?.verified_by(verifier.clone())
}

/// Touches the parts of a scene within its reach, as a bank of such views does, and stitches the maps of them. `progress`: touches
/// done, and all.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames cannot be drawn.
fn mosaics_of_scene(
    drawer: &MapDrawer,
    (scene, views): (&Scene, Views),
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Mosaics> {
    let reach = scene.reach.ok_or_else(|| Error::invalid(&scene.name, "a reach: where parts are touched", "none"))?;
    let xy_step_mm = match reach.xy_half_mm {
        0.0 => reach.xy_step_mm,
        half => half / (half / STEPS[0]).ceil(),
    };
    let poses = PoseGrid { xy_step_mm, theta_half_deg: 180.0, theta_step_deg: STEPS[1], ..reach };
    let seed = seed ^ MOSAICS;
    let simulator = Simulator::new(scene.clone(), seed)?;
    let scene = Scene { reach: Some(poses), ..scene.clone() };
    let planned = [Side::Peg, Side::Hole].map(|side| plan(&scene, &[side], Places::EachPose, seed));
    let [pegs, holes] = planned;
    let planned = [pegs?, holes?].concat();
    let n_stitched = simulator.parts().len() * if views.is_pegs() { 1 } else { 2 };
    let n_touches = n_stitched * poses.len();
    let background = Background::new(&simulator.no_contact(seed), drawer.preprocessing())?;
    let background = background.lit_by(&scene.sensor.known_lamps())?;
    let (done, view_mm) = (AtomicUsize::new(0), scene.sensor.field_of_view_mm);
    let stitch = |at: usize| -> Result<Stitcher> {
        let first = at * poses.len();
        let side = if at < simulator.parts().len() { Side::Peg } else { Side::Hole };
        let touches = &planned[first..first + poses.len()];
        let frames = render(&simulator, seed, first, touches)?;
        let images = frames.par_iter().map(|frame| background.tactile_image(frame));
        let images = images.collect::<tactile_data::Result<Vec<TactileImage>>>()?;
        let mut stitcher = Stitcher::around(reach.xy_half_mm, view_mm);
        for (map, touch) in drawer.draw(&images, side, view_mm)?.iter().zip(touches) {
            stitcher.add(map, &touch.part_from_sensor);
        }
        progress(done.fetch_add(touches.len(), Ordering::Relaxed) + touches.len(), n_touches);
        Ok(stitcher)
    };
    let stitched = threads::each(0..n_stitched, stitch)?;
    let (pegs, holes) = stitched.split_at(simulator.parts().len());
    Mosaics::stitched(pegs, (!holes.is_empty()).then_some(holes))
}
