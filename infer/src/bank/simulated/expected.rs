//! What the touches of a scene's parts come to where they were made: what a verifier says, and how a part seems to differ in size.

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Background;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};

use crate::calibration::{BLANK_SHARE, Spread};
use crate::embedding::threads;
use crate::error::{Error, Result};
use crate::maps::MapDrawer;
use crate::maps::align::Drawing;
use crate::maps::expected::Expected;
use crate::maps::mosaic::Mosaics;
use crate::maps::usual_strain::UsualStrain;
use crate::maps::verifier::{Verifier, compared};

/// Touches of each side of each part.
const N_TOUCHES: u64 = 64;

/// Fewer edged ones say too little.
const ENOUGH: usize = 16;

/// Sets these touches apart from a bank's and from those of its maps.
const TOUCHES: u64 = 0x7665_7269_6669_6564;

/// Touches both sides of a scene's parts anywhere within its reach, and lays them over the parts' maps where they were made.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames cannot be drawn.
pub(super) fn expected_of_scene(
    drawer: &MapDrawer,
    verifier: &Verifier,
    mosaics: &Mosaics,
    scene: &Scene,
    seed: u64,
) -> Result<Expected> {
    let reach = scene.reach.ok_or_else(|| Error::invalid(&scene.name, "a reach: where parts are touched", "none"))?;
    let seed = seed ^ TOUCHES;
    let simulator = Simulator::new(scene.clone(), seed)?;
    let background = Background::new(&simulator.no_contact(seed), drawer.preprocessing())?;
    let background = background.lit_by(&scene.sensor.known_lamps())?;
    let of_part = |part: usize, side: Side| -> Result<Option<(Spread, UsualStrain)>> {
        let mosaic = mosaics.of(part, side);
        let first = 1 + N_TOUCHES * (2 * part as u64 + u64::from(side == Side::Peg));
        let (mut log_odds, mut touches) = (Vec::new(), Vec::new());
        for stream in first..first + N_TOUCHES {
            let mut rng = frame_rng(seed, stream);
            let pose = reach.draw(&mut rng);
            let image = background.tactile_image(&simulator.touch(part, side, &pose, &mut rng)?)?;
            if image.edge_share < BLANK_SHARE {
                continue;
            }
            for map in drawer.draw(&[image], side, scene.sensor.field_of_view_mm)? {
                log_odds.push(verifier.log_odds(&compared((&map, side), &mosaic, &pose)));
                touches.push((map, pose));
            }
        }
        let drawings = touches.iter().map(|(map, pose)| Drawing { map, first_from_sensor: *pose });
        let drawings: Vec<Drawing<'_>> = drawings.collect();
        let is_enough = log_odds.len() >= ENOUGH;
        Ok(is_enough.then(|| (Spread::from_values(&log_odds), UsualStrain::of(&drawings, &mosaic))))
    };
    let of_side = |side| threads::each(0..mosaics.n_parts(), |part| of_part(part, side));
    let (holes, hole_strains) = of_side(Side::Hole)?.into_iter().map(Option::unzip).unzip();
    let (pegs, peg_strains) = of_side(Side::Peg)?.into_iter().map(Option::unzip).unzip();
    Ok(Expected { maps_sha256: verifier.sha256().to_owned(), holes, pegs, hole_strains, peg_strains })
}
