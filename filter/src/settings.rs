//! What a user chooses, and nothing else: the numbers of an episode that neither a calibration nor a bank can know.

use tactile_data::text::number::short;

use crate::error::{Error, Result};
use crate::number::{Range, numbers};

/// The most touches of an episode. Each keeps 5.4 bytes for each view of the bank: its cosine (4), what it shows (1)
/// and the best of each line of places (0.4). In a bank of twelve large letters every 2 mm and 15 degrees all the way
/// round, 127,008 views, that is 0.69 MB a touch, so that these are 0.7 GB; the hundred touches that a patient robot makes are a tenth
/// of it.
const MAX_TOUCHES: f64 = 1_000.0;

/// The most states between two recorded poses on each axis. States grow with its third power: in the bank of
/// [`MAX_TOUCHES`] taking in one touch took up to 1.3 s with 8, on a busy machine 5.3 s, and 0.2 s with 4 (one core of
/// a cloud machine). More than 2 brought no accuracy (`NOTES.md`).
const MAX_SUBDIVISIONS: f64 = 4.0;

/// The most pairs of a drawn and a supposed state that a decision weighs, over all motions that are judged by all draws
/// and those of the first pass. A pair took 5 to 6 ns (1,000 draws, 1,000 suppositions and 24 finalists: 130 ms), so
/// that a decision among [`MOTIONS`] takes at most 0.6 s. By default there are 2e5 of them.
const MAX_PAIRS: f64 = 1e8;

/// Motions that a robot is taken to offer; how many it really does is not known before.
const MOTIONS: usize = 1_000;

/// The first pass weighs a 36th of the pairs of draws and suppositions: a sixth of either.
const FIRST_PASS: f64 = 36.0;

numbers! {
    /// What a user chooses of an episode. Set it by field, or by name ([`Self::set`]), as the programs, the C and Python
    /// interfaces and the ROS parameters do.
    pub struct Settings in "episode" {
        /// Stop when a part is more probable than this (delta_prob) and an edge was felt. 1: never for this reason.
        stop_probability: f64 = 0.95, "", Range::SHARE,
            Chosen: "the paper (Sec. V)"; "no part is ever sure";
        /// To be sure, the place must be known as well: the first touch's to this standard deviation along x and along y.
        /// Only with a bank fine enough to be interpolated. None: sure of the part is sure enough.
        stop_place_mm: Option<f64> = None, "mm", Range::POSITIVE,
            Chosen: "the scene: `assemble` asks for half a millimetre, or straight down for a quarter of the play"; "a peg is inserted where the hole is not";
        /// Stop after this many touches (N_max), the first included.
        max_touches: usize = 10, "", Range::up_to(MAX_TOUCHES),
            Chosen: "the paper (Sec. V)"; "an episode need not end";
        /// A part is named with confidence only where a part that is not in the bank comes to so good a match in at most this share
        /// of the episodes. None: any part explains any touches.
        false_accept: Option<f64> = Some(0.01), "", Range::SHARE,
            Chosen: "one stranger in a hundred"; "a part that is not in the bank is named for its look-alike";
        /// None of these parts are felt where a part that is there comes to so bad a match in less than this share of the
        /// episodes. 0: never.
        false_refuse: f64 = 0.01, "", Range::SHARE,
            Chosen: "one part in a hundred"; "a stranger is touched until the last touch";
        /// Parts, the likeliest first, that a verifier judges after each touch where the model draws maps and the bank has them: by what it
        /// says they are named. 1: only whether the named one is there; 0: none.
        verify: usize = 8, "", Range::NOT_NEGATIVE,
            Chosen: "effort; large letters"; "a name is the embedding's alone";
        /// What a millimetre of travel must tell to be worth it.
        travel_nats_per_mm: f64 = 0.0, "nats/mm", Range::NOT_NEGATIVE,
            Chosen: "what a way costs is the robot's to say"; "a far touch is taken for a little more information";
        /// States drawn from the belief, against which a motion is judged.
        n_draws: usize = 160, "", Range::up_to(1e5),
            Chosen: "effort; a prototype"; "a motion is judged by chance";
        /// States supposed true in turn when a motion is judged.
        n_suppositions: usize = 24, "", Range::up_to(1e4),
            Chosen: "effort; random contours"; "a motion is judged by chance";
        /// Motions judged by all draws, the best of a first pass with a sixth of them. None: all motions.
        n_finalists: Option<usize> = Some(24), "", Range::COUNT,
            Chosen: "effort; a large board of an earlier model"; "every motion costs as much as the best ones";
        /// States between two recorded poses of a bank of 2 mm and 15 degrees, on each axis; no more of a finer bank.
        subdivisions: usize = 2, "", Range::up_to(MAX_SUBDIVISIONS),
            Chosen: "`147iljtfrkzy` in the letters' font; three bring no more"; "ten touches see farther than a bank's step";
        /// Seed of every random draw: same seed and touches, same numbers.
        seed: u64 = 1, "", Range::ANY,
            Chosen: "any"; "two runs differ";
    }
    more {}
}

impl Settings {
    /// Refuses numbers outside their ranges, and effort that takes more than a second for a decision.
    pub(crate) fn validate(&self) -> Result<()> {
        self.check_ranges()?;
        let Self { n_draws, n_suppositions, n_finalists, .. } = *self;
        let pairs = self.n_pairs();
        if pairs <= MAX_PAIRS {
            return Ok(());
        }
        let finalists = n_finalists.map_or("all motions".into(), |n| format!("{n} finalists"));
        let got = format!("{n_draws} x {n_suppositions} for {finalists}, {} pairs", short(pairs.round()));
        let expected = format!("at most {MAX_PAIRS:e} pairs of draws and suppositions among {MOTIONS} motions");
        Err(Error::config("episode.n_draws, n_suppositions, n_finalists", expected, got))
    }

    /// The pairs that a decision weighs among [`MOTIONS`].
    fn n_pairs(&self) -> f64 {
        let motions = MOTIONS as f64;
        let scored = self.n_finalists.map_or(motions, |n| (n as f64).min(motions) + motions / FIRST_PASS);
        self.n_draws as f64 * self.n_suppositions as f64 * scored
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::EpisodeConfig;
    use proptest::prelude::*;

    #[test]
    fn each_setting_is_read_and_written_by_its_name() {
        let mut settings = Settings::default();
        for (name, text) in [
            ("max_touches", "4"),
            ("stop_place_mm", "0.25"),
            ("false_accept", "none"),
            ("seed", "18446744073709551615"),
            ("n_finalists", "none"),
            ("stop_probability", "1"),
        ] {
            settings.set(name, text).unwrap();
            assert_eq!(settings.get(name).unwrap(), text);
        }
        let by_hand = Settings {
            max_touches: 4,
            stop_place_mm: Some(0.25),
            false_accept: None,
            seed: u64::MAX,
            n_finalists: None,
            stop_probability: 1.0,
            ..Settings::default()
        };
        assert_eq!(settings, by_hand);
    }

    #[test]
    fn what_cannot_be_set_is_named_and_changes_nothing() {
        for (name, text, said) in [
            ("max_touches", "0", "episode.max_touches: expected 1 to 1000, got 0"),
            ("max_touches", "-1", "episode.max_touches: expected a whole number, not negative, got -1"),
            ("max_touches", "none", "episode.max_touches: expected a whole number, not negative, got none"),
            ("stop_probability", "NaN", "episode.stop_probability: expected 0..=1, got NaN"),
            ("false_accept", "2", "episode.false_accept: expected 0..=1, or none, got 2"),
            ("stop_place_mm", "0", "episode.stop_place_mm: expected a positive number, or none, got 0"),
            ("travel_nats_per_mm", "inf", "episode.travel_nats_per_mm: expected a number, not negative, got inf"),
            ("n_draws", "many", "episode.n_draws: expected a whole number, not negative, got many"),
            ("n_draws", "1\n2", "episode.n_draws: expected a whole number, not negative, got 1\\n2"),
        ] {
            let mut settings = Settings::default();
            assert_eq!(settings.set(name, text).unwrap_err().to_string(), said);
            assert_eq!(settings, Settings::default());
        }
        let unknown = Settings::default().set("max_touchs", "3").unwrap_err().to_string();
        assert!(unknown.starts_with("episode.max_touchs: expected one of stop_probability, "), "{unknown}");
    }

    proptest! {
        #[test]
        fn a_number_reads_back_to_the_same_bits(p in 0.0..=1.0_f64, mm in 1e-300..1e300_f64, seed in any::<u64>()) {
            let settings =
                Settings { stop_probability: p, stop_place_mm: Some(mm), seed, ..Settings::default() };
            let mut read = Settings::default();
            for number in Settings::numbers() {
                read.set(number.name, &settings.get(number.name).unwrap()).unwrap();
            }
            prop_assert_eq!(read, settings);
        }
    }

    #[test]
    fn what_is_used_and_measured_is_far_below() {
        let of = Settings::default();
        assert!(of.n_pairs() < MAX_PAIRS / 400.0, "{}", of.n_pairs());
        // The richest settings that a trade-off measures.
        for (n_draws, n_suppositions, n_finalists) in [(320, 48, Some(48)), (160, 24, None)] {
            let settings = Settings { n_draws, n_suppositions, n_finalists, subdivisions: 3, ..of };
            assert!(settings.n_pairs() < MAX_PAIRS / 20.0);
            EpisodeConfig { settings, ..EpisodeConfig::default() }.validate().unwrap();
        }
    }

    #[test]
    fn the_readme_lists_them() {
        let readme = include_str!("../README.md");
        let rows = Settings::numbers().iter().map(|number| number.row(&Settings::default()));
        let missing: Vec<String> = rows.filter(|row| !readme.contains(row)).collect();
        assert!(missing.is_empty(), "filter/README.md lacks these rows:\n{}", missing.join("\n"));
    }
}
