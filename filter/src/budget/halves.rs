//! Episodes counted in two halves: one half chooses a setting, the other says what it is worth.

use serde::{Deserialize, Serialize};

use super::speeds::Speeds;

/// Episodes after some touches, in two halves. Who chooses the best of many settings by some episodes has chosen their
/// luck, too: what is promised are the figures of other episodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Halves {
    /// The episodes of every second part: by these a setting is chosen.
    pub choosing: Half,
    /// The episodes of the other parts: what they came to is promised.
    pub promising: Half,
}

/// Episodes of one half, counted after some touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Half {
    /// Episodes.
    pub n_episodes: usize,
    /// How many name the right part after these touches, sure or not.
    pub n_right: usize,
    /// How many the stopping rule ended as confident by then.
    pub n_decided: usize,
    /// How many of them named the right part when they ended.
    pub n_decided_and_right: usize,
    /// Touches of all of them, each until the stopping rule ended it or after these.
    pub touches: usize,
    /// How far the sensor went for these, mm.
    pub travel_mm: f64,
}

impl Halves {
    /// Both halves as one.
    pub fn together(&self) -> Half {
        let [a, b] = [self.choosing, self.promising];
        Half {
            n_episodes: a.n_episodes + b.n_episodes,
            n_right: a.n_right + b.n_right,
            n_decided: a.n_decided + b.n_decided,
            n_decided_and_right: a.n_decided_and_right + b.n_decided_and_right,
            touches: a.touches + b.touches,
            travel_mm: a.travel_mm + b.travel_mm,
        }
    }

    /// Whether no count is of more episodes than there are.
    pub(super) fn add_up(&self) -> bool {
        [self.choosing, self.promising].iter().all(|half| {
            let Half { n_episodes, n_right, n_decided, n_decided_and_right, travel_mm, .. } = *half;
            let is_way = travel_mm >= 0.0 && travel_mm.is_finite();
            n_right <= n_episodes && n_decided_and_right <= n_decided && n_decided <= n_episodes && is_way
        }) && self.choosing.n_episodes > 0
    }
}

impl Half {
    /// Share that names the right part, sure or not, 0..=1; 0 of no episodes.
    pub fn accuracy(&self) -> f64 {
        share(self.n_right, self.n_episodes)
    }

    /// Share that ended sure and right, 0..=1; 0 of no episodes.
    pub fn decided_and_right(&self) -> f64 {
        share(self.n_decided_and_right, self.n_episodes)
    }

    /// Robot seconds of an episode, mean; 0 of no episodes.
    pub fn seconds(&self, speeds: &Speeds) -> f64 {
        speeds.seconds(self.touches, self.travel_mm) / self.n_episodes.max(1) as f64
    }

    /// Robot seconds of all episodes by those that ended sure and right: what each of them cost, the others' time with it;
    /// infinite where none did.
    pub fn seconds_by_decided(&self, speeds: &Speeds) -> f64 {
        speeds.seconds(self.touches, self.travel_mm) / self.n_decided_and_right as f64
    }
}

fn share(n: usize, of: usize) -> f64 {
    n as f64 / of.max(1) as f64
}
