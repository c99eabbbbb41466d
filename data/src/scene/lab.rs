//! What a real recording gets wrong, for simulated ones: a board that is not quite where the robot believes it, stated
//! poses that differ a little from the touched ones, touches that are missing.

use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use crate::dataset::touch::{Planned, Side};
use crate::error::{Error, Result};
use crate::pose::se2::Se2;
use crate::scene::random::frame_rng;

/// A simulated lab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lab {
    /// The pose of the hole board in the peg board's frame, unknown to the robot.
    pub peg_from_hole: Se2,
    /// Standard deviation of a stated pose along x and along y, mm ...
    pub noise_mm: f64,
    /// ... and of its angle, degrees.
    pub noise_deg: f64,
    /// Share of touches that are missing, 0..1.
    pub missing: f64,
}

impl Lab {
    /// Refuses numbers that no lab has.
    pub fn validate(&self) -> Result<()> {
        let noise = [self.noise_mm, self.noise_deg];
        if !noise.iter().all(|value| (0.0..=10.0).contains(value)) {
            return Err(Error::invalid("--lab pose_noise", "0 to 10 mm and degrees", format!("{noise:?}")));
        }
        if !(0.0..=0.9).contains(&self.missing) {
            return Err(Error::invalid("--lab missing", "a share of 0 to 0.9", self.missing.to_string()));
        }
        let Se2 { x_mm, y_mm, .. } = self.peg_from_hole;
        if !(self.peg_from_hole.is_finite() && x_mm.hypot(y_mm) <= 100.0) {
            return Err(Error::invalid("--lab hole_offset", "at most 100 mm", format!("{x_mm}, {y_mm} mm")));
        }
        Ok(())
    }

    /// The touches of a plan as this lab makes them: holes touched where their board really is, poses stated as the
    /// robot reports them. The same seed gives the same lab.
    pub fn record(&self, planned: Vec<Planned>, seed: u64) -> Vec<Planned> {
        let record = |(index, touch): (usize, Planned)| {
            let mut rng = frame_rng(seed ^ 0x6c_61_62, index as u64);
            let is_lost = rng.random::<f64>() < self.missing;
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let [x, y, turn] = [normal() * self.noise_mm, normal() * self.noise_mm, normal() * self.noise_deg];
            let sent = touch.part_from_sensor;
            let part_from_sensor = if touch.side == Side::Hole { self.peg_from_hole * sent } else { sent };
            let stated = Se2::from_degrees(sent.x_mm + x, sent.y_mm + y, sent.theta_deg() + turn);
            (!is_lost).then_some(Planned { part_from_sensor, stated, ..touch })
        };
        planned.into_iter().enumerate().filter_map(record).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lab_loses_and_blurs_as_much_as_it_says() {
        let at = |i: usize| Se2::from_degrees((i % 17) as f64 - 8.0, (i % 13) as f64 - 6.0, (i % 360) as f64 - 180.0);
        let touch = |i: usize, side| Planned { part: 0, side, part_from_sensor: at(i), stated: at(i) };
        let plan: Vec<Planned> =
            (0..8_000).map(|i| touch(i, if i % 2 == 0 { Side::Hole } else { Side::Peg })).collect();
        let offset = Se2::from_degrees(0.4, -0.3, 1.0);
        let lab = Lab { peg_from_hole: offset, noise_mm: 0.1, noise_deg: 0.3, missing: 0.03 };
        let made = lab.record(plan.clone(), 5);
        // 8,000 draws of 3 %: 240, with a deviation of 15.
        assert!((made.len() as f64 - 7_760.0).abs() < 60.0, "{}", made.len());
        let off = |of: fn(Se2) -> f64| {
            let errors = made.iter().map(|touch| {
                let board = if touch.side == Side::Hole { offset } else { Se2::IDENTITY };
                of((board.inverse() * touch.part_from_sensor).inverse() * touch.stated).powi(2)
            });
            (errors.sum::<f64>() / made.len() as f64).sqrt()
        };
        assert!((off(|pose| pose.theta_deg()) - 0.3).abs() < 0.01);
        assert!((off(|pose| pose.x_mm) - 0.1).abs() < 0.004 && (off(|pose| pose.y_mm) - 0.1).abs() < 0.004);
        assert_eq!(lab.record(plan, 5), made);
        for bad in [Lab { missing: 1.0, ..lab }, Lab { noise_mm: f64::NAN, ..lab }, Lab { noise_deg: -1.0, ..lab }] {
            assert!(bad.validate().is_err());
        }
    }
}
