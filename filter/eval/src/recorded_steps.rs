//! A sweep's settings where pegs were recorded: none with finer steps than they were touched at.

use tactile_data::pose::grid::PoseGrid;
use tactile_filter::budget::Setup;
use tactile_infer::bank::recorded::{BankPoses, PegPoses};

use crate::sweep::{Planned, STEPS};

/// The steps at which pegs were recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedSteps {
    /// The grid that they lie on, where there is one.
    grid: Option<PoseGrid>,
    /// Step of places, mm, and of angles, degrees.
    steps: [f64; 2],
}

impl RecordedSteps {
    /// The steps of the grid that pegs lie on; for scattered pegs the steps of the sweep that they are dense enough
    /// for, else the coarsest.
    pub fn of(pegs: &PegPoses) -> Self {
        let steps = match &pegs.grid {
            Some(grid) => [grid.xy_step_mm, grid.theta_step_deg],
            None => pegs.densest(&STEPS).unwrap_or(STEPS[0]),
        };
        Self { grid: pegs.grid, steps }
    }

    /// The settings with their finer steps brought to the recorded ones, none twice: what is between recorded views
    /// would only be interpolated.
    pub fn plan(&self, planned: Vec<Planned>) -> Vec<Planned> {
        let mut kept = Vec::new();
        for mut new in planned {
            let Setup { xy_step_mm, theta_step_deg, .. } = &mut new.settings;
            [*xy_step_mm, *theta_step_deg] = self.had([*xy_step_mm, *theta_step_deg]);
            if !kept.contains(&new) {
                kept.push(new);
            }
        }
        kept
    }

    /// The nearest steps to these that can be had.
    fn had(&self, [mm, deg]: [f64; 2]) -> [f64; 2] {
        let had = |wanted: f64, recorded: f64, is_one_place: bool| match is_one_place {
            // One place has no step: a grid's own is as good as any.
            true => recorded,
            false => wanted.max(recorded),
        };
        let [one_xy, one_theta] = self.grid.map_or([false; 2], |grid| [grid.n_xy() == 1, grid.n_theta() == 1]);
        [had(mm, self.steps[0], one_xy), had(deg, self.steps[1], one_theta)]
    }

    /// How the bank of a setting is made: of the touches as they are where they lie on its grid, else resampled.
    pub fn bank_poses(&self, settings: &Setup) -> BankPoses {
        let is_own = self.grid.is_some_and(|grid| settings.is_of_grid(&grid));
        let resample = (!is_own).then_some([settings.xy_step_mm, settings.theta_step_deg]);
        BankPoses { resample, ..BankPoses::default() }
    }

    /// What a person should know where a plan is not what was planned.
    pub fn note(&self, planned: &[Planned], kept: &[Planned]) -> Option<String> {
        let [mm, deg] = self.steps;
        let about = if self.grid.is_some() { "" } else { "at scattered poses, about " };
        let note = || {
            format!(
                "the pegs were recorded {about}every {mm} mm and {deg} degrees: finer steps are left out, which leaves {} of {} \
                 settings",
                kept.len(),
                planned.len()
            )
        };
        (planned != kept).then(note)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tradeoff::tests::settings;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 6.0, xy_step_mm: 3.0, theta_half_deg: 40.0, theta_step_deg: 20.0 };

    fn planned(steps: &[[f64; 2]]) -> Vec<Planned> {
        let with = |[xy_step_mm, theta_step_deg]: &[f64; 2]| Setup {
            xy_step_mm: *xy_step_mm,
            theta_step_deg: *theta_step_deg,
            ..settings()
        };
        steps.iter().map(|steps| Planned { model: 0, settings: with(steps), strangers: false }).collect()
    }

    fn steps_of(recorded: &RecordedSteps, wanted: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let kept = recorded.plan(planned(wanted));
        kept.iter().map(|kept| [kept.settings.xy_step_mm, kept.settings.theta_step_deg]).collect()
    }

    #[test]
    fn no_step_is_finer_than_what_was_recorded() {
        let recorded = RecordedSteps { grid: Some(GRID), steps: [3.0, 20.0] };
        let kept = steps_of(&recorded, &[[2.0, 15.0], [4.0, 30.0], [4.0, 15.0], [2.0, 30.0], [2.0, 10.0]]);
        assert_eq!(kept, [[3.0, 20.0], [4.0, 30.0], [4.0, 20.0], [3.0, 30.0]]);
        let all = planned(&[[2.0, 15.0], [4.0, 30.0], [2.0, 10.0]]);
        let note = recorded.note(&all, &recorded.plan(all.clone())).unwrap();
        assert!(note.contains("every 3 mm and 20 degrees") && note.ends_with("leaves 2 of 3 settings"), "{note}");
        let coarse = planned(&[[4.0, 30.0], [3.0, 20.0]]);
        assert_eq!(recorded.note(&coarse, &recorded.plan(coarse.clone())), None);
    }

    #[test]
    fn one_angle_has_no_step_to_be_turned() {
        let grid = PoseGrid { theta_half_deg: 0.0, theta_step_deg: 1.0, ..GRID };
        let recorded = RecordedSteps { grid: Some(grid), steps: [3.0, 1.0] };
        assert_eq!(steps_of(&recorded, &[[4.0, 30.0], [4.0, 15.0]]), [[4.0, 1.0]]);
    }

    #[test]
    fn a_bank_of_the_recording_s_own_steps_is_not_resampled() {
        let resample = |recorded: &RecordedSteps, steps| recorded.bank_poses(&planned(&[steps])[0].settings).resample;
        let recorded = RecordedSteps { grid: Some(GRID), steps: [3.0, 20.0] };
        assert_eq!(resample(&recorded, [3.0, 20.0]), None);
        assert_eq!(resample(&recorded, [3.0, 30.0]), Some([3.0, 30.0]));
        let scattered = RecordedSteps { grid: None, ..recorded };
        assert_eq!(resample(&scattered, [3.0, 20.0]), Some([3.0, 20.0]));
    }
}
