//! A bank without a dataset: the pegs of a scene touched and embedded as they come, nothing kept on disk.

use rayon::prelude::*;
use tactile_data::frame::TactileImage;
use tactile_data::generate::{Places, plan, render};
use tactile_data::scene::Scene;
use tactile_data::simulator::Simulator;
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::error::{Error, Result};
use crate::matches::match_touches;
use crate::model::Model;
use crate::rows::Rows;

/// Touches embedded at a time.
const CHUNK: usize = 256;

/// The bank of a scene's pegs at the poses of its reach: to the bit the one that a dataset of them, generated with
/// this seed, gives.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames the model cannot take.
pub fn bank_of_scene(
    model: &Model,
    scene: &Scene,
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Bank> {
    let simulator = Simulator::new(scene.clone(), seed)?;
    let Some(reach) = scene.reach else {
        return Err(Error::invalid(&scene.name, "a reach: the poses at which each peg is touched", "none"));
    };
    let planned = plan(scene, &[Side::Peg], Places::EachPose, seed)?;
    let background = model.background(&simulator.no_contact(seed))?.lit_by(&scene.sensor.known_lamps())?;
    let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
    for (chunk, touches) in planned.chunks(CHUNK).enumerate() {
        progress(chunk * CHUNK, planned.len());
        let frames = render(&simulator, seed, chunk * CHUNK, touches)?;
        let see = |frame| -> Result<TactileImage> { Ok(background.tactile_image(frame)?) };
        let images = frames.par_iter().map(see).collect::<Result<Vec<_>>>()?;
        rows.extend(model.embed_pegs(&images)?);
        edge_shares.extend(images.iter().map(|image| image.edge_share));
    }
    progress(planned.len(), planned.len());
    let parts = simulator.parts().to_vec();
    let bank = Bank::of_rows(parts, reach, Rows::new(model.dim(), rows)?, edge_shares, model.sha256().clone())?;
    with_geometry(model, bank.with_origin(scene.origin()), &simulator, seed)
}

/// A bank of a scene's parts with what only their geometry tells: symmetries, and how well touches made now match the views.
///
/// # Errors
/// A touch that cannot be made or seen.
pub(crate) fn with_geometry(model: &Model, bank: Bank, simulator: &Simulator, seed: u64) -> Result<Bank> {
    let of_name = |name: &String| simulator.parts().iter().position(|part| part == name).unwrap_or(0);
    let parts: Vec<usize> = bank.parts().iter().map(of_name).collect();
    let symmetries = parts.par_iter().map(|part| simulator.symmetry(*part)).collect();
    let matches = match_touches(model, &bank, simulator, &parts, seed)?;
    bank.with_symmetries(symmetries)?.with_matches(matches)
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use super::*;
    use crate::architecture::NetworkConfig;
    use crate::checkpoint::{Checkpoint, Provenance};
    use crate::device::DeviceKind;
    use crate::recorded::{BankPoses, bank_of_dataset};
    use tactile_data::frame::Preprocessing;
    use tactile_data::generate::{Sampling, generate};
    use tactile_data::grid::PoseGrid;
    use tactile_data::scene::{Kit, Parts};
    use tactile_data::store::Dataset;

    #[test]
    fn a_bank_without_a_dataset_is_the_one_of_a_dataset() {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("KL", 12.0, 16.0));
        scene.reach = Some(PoseGrid { xy_half_mm: 8.0, xy_step_mm: 4.0, theta_half_deg: 45.0, theta_step_deg: 45.0 });
        scene.sensor.frame_px = [40, 30];
        let config = NetworkConfig { input_px: [16, 12], width: 8, hidden: 16, dim: 8 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let model = Model::new(checkpoint, "ab".into(), DeviceKind::Flex).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("pegs");
        let sampling = Sampling { sides: &[Side::Peg], places: Places::EachPose, seed: 5, lab: None };
        generate(&scene, &sampling, &out, &|_, _| ()).unwrap();
        let dataset = Dataset::open(&out).unwrap();
        let recorded = bank_of_dataset(&model, &dataset, BankPoses::default(), &|_, _| ()).unwrap();
        let bank = bank_of_scene(&model, &scene, 5, &|_, _| ()).unwrap();
        assert_eq!(bank, recorded.bank);
        // At a recorded pose a peg is its own view but for noise and the place's jitter; a hole is another side.
        for part in 0..2 {
            let of = |side| bank.matches().of(part, side).unwrap();
            let (pegs, holes) = (of(Side::Peg), of(Side::Hole));
            assert!(pegs.matched.mean > 0.9 && (0.0..0.1).contains(&pegs.gap.mean), "{pegs:?}");
            assert!(holes.matched.mean < pegs.matched.mean && holes.gap.mean > pegs.gap.mean, "{holes:?}");
        }
        assert!(recorded.notes.is_empty(), "{:?}", recorded.notes);
    }
}
