//! A bank without a dataset: the parts of a scene touched and embedded as they come, nothing kept on disk.

use rayon::prelude::*;
use tactile_data::frame::{Background, Frame, TactileImage};
use tactile_data::generate::{Places, Planned, plan, render};
use tactile_data::scene::Scene;
use tactile_data::simulator::Simulator;
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::calibration::BLANK_SHARE;
use crate::error::{Error, Result};
use crate::matches::match_touches;
use crate::model::Model;
use crate::rows::Rows;
use crate::views::{Views, to_middle};

/// Touches embedded at a time.
const CHUNK: usize = 256;

/// Sets the draws of the holes apart from those of the pegs.
const HOLES: u64 = 0x686f_6c65_7300_0000;

/// The bank of a scene's parts at the poses of its reach. Of views of pegs it is to the bit the one that a dataset of them,
/// generated with this seed, gives.
///
/// # Errors
/// A scene without a reach, or that cannot be touched, or whose frames the model cannot take.
pub fn bank_of_scene(
    model: &Model,
    scene: &Scene,
    views: Views,
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
        let images = see(&background, &frames)?;
        let first_row = rows.len();
        rows.extend(model.embed_pegs(&images)?);
        edge_shares.extend(images.iter().map(|image| image.edge_share));
        if views == Views::Both {
            let of_holes: Vec<Planned> = touches.iter().map(|touch| Planned { side: Side::Hole, ..*touch }).collect();
            let holes = see(&background, &render(&simulator, seed ^ HOLES, chunk * CHUNK, &of_holes)?)?;
            let queries = model.embed_holes(&holes)?;
            let keys = rows[first_row..].chunks_exact_mut(model.dim()).zip(queries.chunks_exact(model.dim()));
            // A hole that shows no edge where its peg does tells nothing of what it looks like.
            let edged = keys.zip(&holes).filter(|(_, hole)| hole.edge_share >= BLANK_SHARE);
            edged.for_each(|((key, query), _)| to_middle(key, query));
        }
    }
    progress(planned.len(), planned.len());
    let parts = simulator.parts().to_vec();
    let bank = Bank::of_rows(parts, reach, Rows::new(model.dim(), rows)?, edge_shares, model.sha256().clone())?;
    let bank = bank.with_views(views);
    with_geometry(model, bank.with_origin(scene.origin()), &simulator, seed)
}

fn see(background: &Background, frames: &[Frame]) -> Result<Vec<TactileImage>> {
    frames.par_iter().map(|frame| Ok(background.tactile_image(frame)?)).collect()
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
    use crate::similarity::dot;
    use tactile_data::frame::Preprocessing;
    use tactile_data::generate::{Sampling, generate};
    use tactile_data::grid::PoseGrid;
    use tactile_data::scene::{Kit, Parts};
    use tactile_data::store::Dataset;

    /// Two letters at few poses, and a small network that has learnt nothing.
    fn scene_and_model() -> (Scene, Model) {
        let mut scene = Scene::preset("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit::of_letters("KL", 12.0, 16.0));
        scene.reach = Some(PoseGrid { xy_half_mm: 8.0, xy_step_mm: 4.0, theta_half_deg: 45.0, theta_step_deg: 45.0 });
        scene.sensor.frame_px = [40, 30];
        let config = NetworkConfig { input_px: [16, 12], width: 8, hidden: 16, dim: 8 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        (scene, Model::new(checkpoint, "ab".into(), DeviceKind::Flex).unwrap())
    }

    /// The dataset of a side, drawn from a seed.
    fn touches(scene: &Scene, side: Side, seed: u64, out: &std::path::Path) -> Dataset {
        let sampling = Sampling { sides: &[side], places: Places::EachPose, seed, lab: None };
        generate(scene, &sampling, out, &|_, _| ()).unwrap();
        Dataset::open(out).unwrap()
    }

    #[test]
    fn a_bank_without_a_dataset_is_the_one_of_a_dataset() {
        let (scene, model) = scene_and_model();
        let folder = tempfile::tempdir().unwrap();
        let dataset = touches(&scene, Side::Peg, 5, &folder.path().join("pegs"));
        let recorded = bank_of_dataset(&model, &dataset, BankPoses::default(), &|_, _| ()).unwrap();
        let bank = bank_of_scene(&model, &scene, Views::Pegs, 5, &|_, _| ()).unwrap();
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

    #[test]
    fn a_view_of_both_sides_is_as_near_to_the_peg_as_to_the_hole() {
        let (scene, model) = scene_and_model();
        let [pegs, both] =
            [Views::Pegs, Views::Both].map(|of| bank_of_scene(&model, &scene, of, 5, &|_, _| ()).unwrap());
        assert_eq!([pegs.views(), both.views()], [Views::Pegs, Views::Both]);
        assert_eq!(both.with_parts(&[1]).unwrap().views(), Views::Both);
        let folder = tempfile::tempdir().unwrap();
        let dataset = touches(&scene, Side::Hole, 5 ^ HOLES, &folder.path().join("holes"));
        let background = model.background(&Simulator::new(scene, 5).unwrap().no_contact(5)).unwrap();
        let mut n_middle = 0;
        for row in 0..both.n_rows() {
            let image = background.tactile_image(&dataset.frame(row)).unwrap();
            let hole = model.embed_holes(std::slice::from_ref(&image)).unwrap();
            let [peg, key] = [&pegs, &both].map(|bank| bank.row(row).into_owned());
            if image.edge_share < BLANK_SHARE {
                assert_eq!(key, peg);
                continue;
            }
            n_middle += 1;
            let [to_peg, to_hole] = [&peg, &hole].map(|side| dot(&key, side));
            assert!((to_peg - to_hole).abs() < 1e-5 && to_peg > dot(&peg, &hole) - 1e-5, "{to_peg} {to_hole}");
        }
        assert!(n_middle > both.n_rows() / 2, "{n_middle}");
        // What was simulated matches better.
        let matched = |bank: &Bank| bank.matches().of(0, Side::Hole).unwrap().matched.mean;
        assert!(matched(&both) > matched(&pegs));
        // The file says so, and the checksum tells them apart.
        let path = folder.path().join("both.bank");
        both.save(&path).unwrap();
        assert_eq!(Bank::load(&path, &model).unwrap(), both);
        assert_ne!(both.sha256().unwrap(), pegs.sha256().unwrap());
    }
}
