//! What an evaluation found, as other programs read it: `evaluation.json`.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_filter::budget::{Speeds, Tradeoff};
use tactile_infer::{Model, Views};

use crate::statistics::mcnemar::Paired;
use crate::statistics::share::wilson_95;

/// The value of [`Evaluation::schema`].
pub const SCHEMA: &str = "tactile-filter/evaluation/1";

/// A whole evaluation of one scene with one model. Fields that are `Option` are left out where absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// [`SCHEMA`].
    pub schema: String,
    /// Name of the scene.
    pub scene: String,
    /// Parts that the filter chose from.
    pub n_classes: usize,
    /// Episodes behind each row, over all seeds.
    pub n_episodes: usize,
    /// Seeds of the episodes.
    pub seeds: Vec<u64>,
    /// Prints of each part that holes were touched on.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub n_prints: usize,
    /// Pairs of part and pose, or recorded frames, that the episodes began with; of one touch no more can be known.
    /// `None` where they began anywhere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distinct_first_views: Option<usize>,
    /// Holes of a run that were named with confidence before each episode: what they told of the sensor was known.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub n_earlier: usize,
    /// Whether each hole's own part was taken out of the bank: no answer is then right but "none of these".
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub absent: bool,
    /// Whether the holes were recorded; else they were simulated.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub recorded: bool,
    /// The parts that were recorded, where these are some of the bank's only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recorded_parts: Vec<String>,
    /// Which side was touched: with `peg` the pegs were named, in all that is said of holes.
    #[serde(default, skip_serializing_if = "Side::is_hole")]
    pub side: Side,
    /// What the bank's views are of.
    #[serde(default, skip_serializing_if = "Views::is_pegs")]
    pub views: Views,
    /// The model that embedded the touches.
    pub model: ModelRecord,
    /// Device of the network.
    pub device: String,
    /// Threads that worked.
    pub n_threads: usize,
    /// A figure for each way of inferring and number of touches.
    pub rows: Vec<Row>,
    /// What the stopping rule did.
    pub stopping: Stopping,
    /// How long each stage took, milliseconds.
    pub latency_ms: Latency,
    /// What the stopping rule did with each way of inferring and choosing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stops: Vec<Stops>,
    /// Rules of choice compared on the same holes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub comparisons: Vec<Comparison>,
    /// Whether what the filter is sure of is right: the first way of inferring, over all touches.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reliability: Vec<ReliabilityBin>,
    /// How each part fares: the first way of inferring, after its last touch.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<PartFigures>,
    /// How each stranger fares: the first way of inferring, where it stops.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub strangers: Vec<StrangerFigures>,
    /// The command line that makes this evaluation again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<String>,
    /// What the settings promised, where they were chosen for a budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub promise: Option<Promise>,
    /// Checksum of what each episode came to, without the times: the same however the work was divided.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksum: Option<String>,
}

/// The number of prints where none is noted.
pub(crate) fn one() -> usize {
    1
}

pub(crate) fn is_zero(n: &usize) -> bool {
    *n == 0
}

pub(crate) fn is_one(n: &usize) -> bool {
    *n == 1
}

/// Setup chosen for a budget, what they should cost on this machine and what they should reach.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Promise {
    /// The settings, in words.
    pub settings: String,
    /// Median time of a decision on one core, ms.
    pub decision_ms: f64,
    /// What an episode holds, 10^6 bytes.
    pub memory_mb: f64,
    /// Touches of it.
    pub n_touches: usize,
    /// Name of the scene, or of the recording of the holes, that the shares were measured on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Share of episodes that end sure and right within these touches: of episodes that did not choose the settings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decided_and_right: Option<PromisedShare>,
    /// Share of the same episodes that names the right part after these touches, sure or not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<PromisedShare>,
    /// Robot seconds of the same episodes, mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_s: Option<f64>,
}

/// A share of episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PromisedShare {
    /// The share, 0..=1.
    pub share: f64,
    /// Bounds of its 95 % interval.
    pub ci95: [f64; 2],
    /// Episodes behind it.
    pub n_episodes: usize,
}

impl Promise {
    /// What a setting chosen from a trade-off promises of a robot of these speeds; `settings` names it.
    pub fn of(choice: &tactile_filter::budget::Choice, tradeoff: &Tradeoff, speeds: &Speeds, settings: String) -> Self {
        let half = choice.point.halves.promising;
        let share = |n: usize| PromisedShare {
            share: n as f64 / half.n_episodes.max(1) as f64,
            ci95: wilson_95(n, half.n_episodes),
            n_episodes: half.n_episodes,
        };
        Self {
            settings,
            decision_ms: choice.decision_ms,
            memory_mb: choice.memory_mb,
            n_touches: choice.point.n_touches,
            scene: Some(tradeoff.scene.clone()),
            decided_and_right: Some(share(half.n_decided_and_right)),
            accuracy: Some(share(half.n_right)),
            robot_s: Some(half.seconds(speeds)),
        }
    }
}

/// Which model it was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelRecord {
    /// Its name.
    pub name: String,
    /// SHA-256 of the checkpoint, hexadecimal.
    pub sha256: String,
    /// Trained numbers in it.
    pub parameters: usize,
    /// Width and height of its input, pixels.
    pub input_px: [usize; 2],
}

impl ModelRecord {
    /// What is recorded of a model.
    pub fn of(model: &Model) -> Self {
        Self {
            name: model.provenance().name.clone(),
            sha256: model.sha256().to_string(),
            parameters: model.n_parameters(),
            input_px: model.config().input_px,
        }
    }
}

/// How a part was named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The nearest recorded frame, pixel by pixel; one touch.
    Pixel,
    /// The nearest recorded embedding; one touch.
    Moco,
    /// The filter over all touches.
    Filter,
}

/// How the belief was kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Inference {
    /// The probability of every state.
    Exact,
    /// A sample of the states.
    Particle,
    /// No belief: a single touch decides.
    None,
}

/// How the next touch was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// The paper's rule (Eq. 5 and 6).
    Paper,
    /// The largest expected gain of information.
    Information,
    /// Any, each equally likely.
    Random,
    /// Any that would show an edge from the likeliest state, each equally likely.
    #[serde(rename = "random-edge")]
    RandomEdge,
    /// No further touch.
    None,
}

/// Where the true poses were.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Poses {
    /// On the recorded grid, as the paper has it.
    OnGrid,
    /// Anywhere in the grid's range, at any angle.
    OffGrid,
}

/// One way of inferring after one number of touches. Errors are those of episodes that named the right part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// How the part was named.
    pub method: Method,
    /// How the belief was kept.
    pub inference: Inference,
    /// How touches were chosen.
    pub action: Choice,
    /// Where the true poses were.
    pub poses: Poses,
    /// Touches so far, the first included.
    pub n_touches: usize,
    /// Share of episodes that name the right part, 0..=1.
    pub accuracy: f64,
    /// Bounds of the 95 % interval of `accuracy`: Wilson's, of episodes that are independent; after one touch at
    /// recorded poses of as many as there are different first views.
    pub accuracy_ci95: [f64; 2],
    /// Bounds of the 95 % interval of `accuracy` that covers other parts of the kind and other prints of them, of the
    /// same model: whole parts are drawn anew ([`clustered_95`](crate::statistics::bootstrap::clustered_95)). No
    /// narrower than `accuracy_ci95`: where all parts are named rightly, they do not say how much parts differ.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accuracy_ci95_clustered: Option<[f64; 2]>,
    /// After this number of touches against one touch less: `better` episodes are right now and were not, `worse` were
    /// right and are no longer. `None` after the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub against_one_less: Option<Paired>,
    /// Share of episodes that name the right part and the cell nearest to the true pose, 0..=1.
    pub exact_cell: f64,
    /// Mean distance to the true place, mm.
    pub xy_mm_mean: f64,
    /// Mean angle to the true angle, degrees, modulo the part's symmetry.
    pub theta_deg_mean: f64,
    /// Mean Brier score of the class posterior, 0 (certain and right) to 2 (certain and wrong).
    pub brier: f64,
    /// Median distance to the true place, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub xy_mm_median: Option<f64>,
    /// Median angle to the true angle, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theta_deg_median: Option<f64>,
    /// Episodes that name the right part: those behind the errors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_correct: Option<usize>,
    /// Mean difference between the probability of the part named and the share of episodes in which it is right, over
    /// tenths of that probability weighed by their episodes (expected calibration error), 0..=1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration_error: Option<f64>,
    /// Bounds of its 95 % interval, by drawing parts anew. Chance adds to such an error, and drawing adds once more:
    /// percentiles lie too high, so that the lower bound is mirrored where that is lower (the basic bootstrap's).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration_error_ci95: Option<[f64; 2]>,
    /// Mean squared pose error of place and angle, normalised by the covariance that the filter stated: 3 where that is
    /// right. `None` where poses are those of recorded views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalised_pose_error: Option<f64>,
    /// Share of poses within the ellipsoid that should hold 95 %, 0..=1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub within_ellipsoid: Option<f64>,
}

/// What the stopping rule did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stopping {
    /// Mean number of touches when the episode stopped.
    pub mean_touches: f64,
    /// Share of episodes that stopped as confident and named the wrong part, 0..=1.
    pub confident_and_wrong: f64,
}

/// What the stopping rule did with one way of inferring and choosing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stops {
    /// How the belief was kept.
    pub inference: Inference,
    /// How touches were chosen.
    pub action: Choice,
    /// Mean number of touches when the episode stopped.
    pub mean_touches: f64,
    /// Share of episodes that stopped as confident, 0..=1.
    pub confident: f64,
    /// Share of those that named the wrong part.
    pub confident_and_wrong: f64,
    /// Share of episodes that stopped because no part explains the touches.
    pub none_of_these: f64,
    /// Mean number of touches until a part is 95 % sure, whatever its fit; episodes that never are count
    /// as one more than their touches.
    pub touches_to_95: f64,
    /// Mean seconds that a robot takes until the episode stops; absent where nobody noted its ways.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

/// Two rules of choice on the same holes after the same number of touches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// How the belief was kept.
    pub inference: Inference,
    /// One rule.
    pub action: Choice,
    /// The other.
    pub against: Choice,
    /// Touches so far.
    pub n_touches: usize,
    /// Accuracy of the one less that of the other, -1..=1.
    pub difference: f64,
    /// Bounds of the 95 % interval of the paired difference.
    pub ci95: [f64; 2],
    /// Episodes that one rule alone names rightly, and whether chance explains that: `better`, `worse` and `p_value`.
    #[serde(flatten)]
    pub paired: Option<Paired>,
}

/// Touches whose most probable part had a probability in one range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReliabilityBin {
    /// Range of the probability.
    pub probability: [f64; 2],
    /// Mean probability within it.
    pub mean_probability: f64,
    /// Share that was right.
    pub right: f64,
    /// Bounds of the 95 % interval of that share. Touches of one episode resemble each other: it is of as many touches
    /// as episodes that differ so much allow ([`grouped_95`](crate::statistics::share::grouped_95)).
    pub right_ci95: [f64; 2],
    /// Touches counted, over all episodes.
    pub n: usize,
    /// Episodes that they are of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_episodes: Option<usize>,
}

/// The holes of one part after their last touch. Errors are those of holes whose part was named rightly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartFigures {
    /// Name of the part.
    pub part: String,
    /// Holes of it.
    pub n: usize,
    /// How many were named rightly.
    pub n_right: usize,
    /// The part most often named instead, and how often; `None` where none was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mistaken_for: Option<(String, usize)>,
    /// Mean distance to the true place, mm.
    pub xy_mm_mean: f64,
    /// Mean angle to the true angle, degrees, modulo the part's symmetry.
    pub theta_deg_mean: f64,
}

/// The holes of one part that was taken out of the bank, where their episodes stop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrangerFigures {
    /// Name of the part.
    pub part: String,
    /// Holes of it.
    pub n: usize,
    /// How many were recognised as none of the bank's parts.
    pub n_none: usize,
    /// The parts that were named with confidence, and how often, the most often named first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub named: Vec<(String, usize)>,
}

impl StrangerFigures {
    /// How many were named with confidence.
    pub fn n_named(&self) -> usize {
        self.named.iter().map(|(_, n)| n).sum()
    }

    /// The parts that were named, and how often: `F (3), L (1)`; a dash where none was.
    pub fn named_line(&self) -> String {
        let named: Vec<String> = self.named.iter().map(|(part, n)| format!("{part} ({n})")).collect();
        if named.is_empty() { "–".into() } else { named.join(", ") }
    }
}

/// How long each stage of one touch took, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    /// Frame to embedding.
    pub encode: Quantiles,
    /// Embedding to belief.
    pub update: Quantiles,
    /// Belief to what is said of part and place; `None` of a program that did not measure it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judge: Option<Quantiles>,
    /// From there to the next touch.
    pub select: Quantiles,
    /// All of them, where a next touch was chosen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decision: Option<Quantiles>,
}

/// Two quantiles of a duration, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// Half take no longer.
    pub p50: f64,
    /// 99 in 100 take no longer.
    pub p99: f64,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::report::tradeoff::tests::tradeoff;
    use serde_json::{Value, json};
    use tactile_filter::budget::{Budget, Cost, Half, Halves, Point, Setup};

    /// An evaluation in the schema as it is published, every optional field absent.
    pub(crate) fn published() -> Value {
        json!({
            "schema": "tactile-filter/evaluation/1", "scene": "alphabet-small", "n_classes": 12, "n_episodes": 500,
            "seeds": [1, 2, 3],
            "model": {"name": "m", "sha256": "ab", "parameters": 7, "input_px": [80, 60]},
            "device": "flex", "n_threads": 2,
            "rows": [
                {"method": "filter", "inference": "exact", "action": "information", "poses": "on-grid",
                 "n_touches": 3, "accuracy": 0.9, "accuracy_ci95": [0.87, 0.92], "exact_cell": 0.8,
                 "xy_mm_mean": 0.2, "theta_deg_mean": 0.9, "brier": 0.1},
                {"method": "moco", "inference": "none", "action": "none", "poses": "off-grid",
                 "n_touches": 1, "accuracy": 0.5, "accuracy_ci95": [0.46, 0.54], "exact_cell": 0.25,
                 "xy_mm_mean": 1.0, "theta_deg_mean": 4.0, "brier": 0.75}],
            "stopping": {"mean_touches": 2.5, "confident_and_wrong": 0.0625},
            "latency_ms": {"encode": {"p50": 5.0, "p99": 7.0}, "update": {"p50": 0.5, "p99": 1.0},
                           "select": {"p50": 3.0, "p99": 4.0}}
        })
    }

    #[test]
    fn json_has_exactly_the_published_keys_and_words() {
        let evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        assert_eq!(evaluation.schema, SCHEMA);
        assert_eq!(serde_json::to_value(&evaluation).unwrap(), published());
    }

    #[test]
    fn what_is_promised_is_of_the_half_that_did_not_choose() {
        let mut tradeoff = tradeoff();
        let promise = |tradeoff: &Tradeoff| {
            let here = |p: &Point| Cost { pace_ms: p.pace_ms, memory_mb: p.memory_mb };
            let point = tradeoff.points[5].clone();
            let mut only = |settings: &Setup, n: usize| {
                Ok((*settings == point.settings && n == point.n_touches).then(|| here(&point)))
            };
            let (budget, speeds) = (Budget::default(), Speeds { touch_s: 2.0, ..Speeds::default() });
            let choice = tradeoff.choose(&budget, &speeds, &mut only).unwrap();
            Promise::of(&choice, tradeoff, &speeds, "s".into())
        };
        let half = |n_decided_and_right, n_episodes| Half {
            n_episodes,
            n_right: 160,
            n_decided: 100,
            n_decided_and_right,
            touches: 3 * n_episodes,
            travel_mm: 0.0,
        };
        for point in &mut tradeoff.points {
            point.halves = Halves { choosing: half(99, 264), promising: half(81, 263) };
        }
        let promise = promise(&tradeoff);
        let PromisedShare { share, ci95: [low, high], n_episodes } = promise.decided_and_right.unwrap();
        // Newcombe 1998, Table I, method 3.
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5);
        assert_eq!((share, n_episodes, promise.accuracy.unwrap().share), (81.0 / 263.0, 263, 160.0 / 263.0));
        assert_eq!((promise.n_touches, promise.scene.as_deref()), (1, Some("a<b")));
        assert_eq!(promise.robot_s, Some(6.0));
    }

    #[test]
    fn optional_figures_are_kept() {
        let mut more = published();
        more["command"] = json!("tactile-filter evaluate");
        more["absent"] = json!(true);
        more["rows"][0]["n_correct"] = json!(450);
        more["rows"][0]["accuracy_ci95_clustered"] = json!([0.8, 1.0]);
        more["rows"][0]["against_one_less"] = json!({"better": 9, "worse": 1, "p_value": 0.021484375});
        let plain = json!({"inference": "exact", "action": "information", "against": "random", "n_touches": 2,
                           "difference": 0.25, "ci95": [0.125, 0.375]});
        let mut tested = plain.clone();
        for (key, value) in [("better", json!(12)), ("worse", json!(3)), ("p_value", json!(0.03515625))] {
            tested[key] = value;
        }
        more["comparisons"] = json!([plain, tested]);
        more["n_prints"] = json!(4);
        more["distinct_first_views"] = json!(6);
        let evaluation: Evaluation = serde_json::from_value(more.clone()).unwrap();
        assert_eq!(serde_json::to_value(&evaluation).unwrap(), more);
    }
}
