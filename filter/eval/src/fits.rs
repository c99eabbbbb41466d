//! Whether a bank fits what it is used for.

use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, Touch};
use tactile_data::scene::Scene;
use tactile_filter::likelihood::interpolation::Interpolation;
use tactile_infer::Bank;

use crate::error::{Error, Result};
use crate::holes::Holes;
use crate::result::Poses;

/// Refuses a bank whose parts, sizes, scale or lamps are not those of a scene. `other_sensor`: whether another sensor than
/// the bank's is wanted.
///
/// # Errors
/// What differs, in the bank and in the scene.
pub fn check_bank(bank: &Bank, scene: &Scene, other_sensor: bool) -> Result<()> {
    let wanted = scene.origin();
    let names = scene.part_names();
    if names != bank.parts() {
        let expected = format!("the parts of scene {}, {}", scene.name, names.join(" "));
        return Err(Error::invalid("bank", expected, bank.parts().join(" ")));
    }
    let Some(origin) = bank.origin() else { return Ok(()) };
    let sensor = if other_sensor { None } else { origin.other_sensor(&wanted) };
    match origin.other_parts(&wanted).or(sensor) {
        Some([what, in_bank, in_scene]) => {
            let place = format!("bank of {}: {what}", origin.name);
            Err(Error::invalid(place, format!("{in_scene} as in scene {}", scene.name), in_bank))
        }
        None => Ok(()),
    }
}

/// A warning where touches are not where a bank can be compared with them: recorded ones that are said to lie at its
/// poses and do not, or any between poses that are too far from each other to be interpolated.
pub fn warn_of_poses(holes: Holes<'_>, bank: &Bank, poses: Poses) -> Option<String> {
    match (poses, holes) {
        (Poses::OnGrid, Holes::Recorded(recorded)) => recorded.between_poses_of(bank),
        (Poses::OffGrid, _) => too_coarse(bank),
        _ => None,
    }
}

/// A warning where touches are played back that are not known to lie at a bank's poses, which are too far from each other to
/// be interpolated. Most of such touches match no view well: nothing is then sure, and most are taken for none of the parts.
pub fn warn_of_played(dataset: &Dataset, side: Side, bank: &Bank) -> Option<String> {
    let is_at_a_view = |touch: &Touch| match (&touch.part, &touch.part_from_sensor) {
        // A part that the bank lacks matches no view anyway.
        (Some(part), Some(pose)) => !bank.parts().contains(part) || bank.row_at(part, pose).is_some(),
        _ => false,
    };
    let mut played = dataset.touches().iter().filter(|touch| touch.side.is_none_or(|of| of == side));
    too_coarse(bank).filter(|_| !played.all(is_at_a_view))
}

/// Why touches anywhere do not suit a bank; `None` where they do.
pub fn too_coarse(bank: &Bank) -> Option<String> {
    let grid = bank.grid();
    (!Interpolation::Auto.is_cubic(grid)).then(|| {
        format!(
            "touches lie anywhere, but the bank's poses are {} mm and {} degrees apart, too far to interpolate: expect \
             errors; record it every 2 mm and 15 degrees",
            grid.xy_step_mm, grid.theta_step_deg
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::pose::grid::PoseGrid;
    use tactile_data::sensor::simulator::Simulator;
    use tactile_infer::bank::rows::Rows;

    fn bank(scene: &Scene, grid: PoseGrid) -> Bank {
        let names = scene.part_names();
        let n_rows = names.len() * grid.len();
        let rows = Rows::new(2, [1.0, 0.0].repeat(n_rows)).unwrap();
        Bank::from_rows(names, grid, rows, vec![0.5; n_rows], "").unwrap().with_origin(scene.origin())
    }

    #[test]
    fn a_bank_of_another_scene_is_refused_with_what_differs() {
        let small = Scene::preset("alphabet-small").unwrap();
        let one_pose = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };
        let bank = bank(&small, one_pose);
        check_bank(&bank, &small, false).unwrap();
        let error = |scene: &str| check_bank(&bank, &Scene::preset(scene).unwrap(), false).unwrap_err().to_string();
        assert!(
            error("connectors").starts_with("bank: expected the parts of scene connectors"),
            "{}",
            error("connectors")
        );
        let large = error("alphabet-large");
        assert!(large.starts_with("bank of alphabet-small: size of part A: expected"), "{large}");
        let mut wide = small.clone();
        wide.sensor.field_of_view_mm = [20.3, 15.2];
        let scale = check_bank(&bank, &wide, false).unwrap_err().to_string();
        assert!(scale.contains("field of view: expected 20.3 x 15.2 mm"), "{scale}");
        check_bank(&bank, &wide, true).unwrap();
    }

    #[test]
    fn only_touches_between_coarse_poses_are_warned_of() {
        let small = Scene::preset("alphabet-small").unwrap();
        let simulator = Simulator::new(small.clone(), 1).unwrap();
        let warning = |grid, poses| warn_of_poses(Holes::Simulated(&simulator, Side::Hole), &bank(&small, grid), poses);
        assert!(warning(PoseGrid::SMALL, Poses::OffGrid).is_some());
        assert!(warning(PoseGrid::SMALL, Poses::OnGrid).is_none());
        let fine = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 15.0, theta_step_deg: 15.0 };
        assert!(warning(fine, Poses::OffGrid).is_none());
    }

    #[test]
    fn played_touches_between_coarse_poses_are_warned_of() {
        use tactile_data::dataset::store::{DatasetWriter, Meta};
        use tactile_data::frame::Frame;
        use tactile_data::pose::se2::Se2;

        let small = Scene::preset("alphabet-small").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let dataset = |name: &str, pose: Option<Se2>| {
            let frame = Frame::new(4, 2, (0..24).collect()).unwrap();
            let path = folder.path().join(name);
            let mut writer =
                DatasetWriter::create(&path, Meta::new(name, "a test", [4, 2], [4.65, 7.15]), &frame).unwrap();
            let touch = |side, pose| Touch {
                part: Some("A".into()),
                side: Some(side),
                part_from_sensor: pose,
                ..Touch::default()
            };
            writer.push(&frame, &touch(Side::Peg, pose)).unwrap();
            // The other side does not count.
            writer.push(&frame, &touch(Side::Hole, Some(Se2::new(1.0, 1.0, 0.0)))).unwrap();
            writer.finish().unwrap();
            Dataset::open(&path).unwrap()
        };
        let coarse = bank(&small, PoseGrid { xy_half_mm: 4.0, theta_half_deg: 30.0, ..PoseGrid::SMALL });
        let warned = |name, pose| warn_of_played(&dataset(name, pose), Side::Peg, &coarse).is_some();
        assert!(!warned("at", Some(Se2::IDENTITY)));
        assert!(warned("between", Some(Se2::new(2.0, 2.0, 0.0))) && warned("unknown", None));
        let fine = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 15.0, theta_step_deg: 15.0 };
        let unknown = Dataset::open(&folder.path().join("unknown")).unwrap();
        assert!(warn_of_played(&unknown, Side::Peg, &bank(&small, fine)).is_none());
    }
}
