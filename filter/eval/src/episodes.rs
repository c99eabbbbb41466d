//! What happened in the episodes of an evaluation, before it becomes figures: a shard's file, and how shards become one.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tactile_data::dataset::touch::Side;
use tactile_data::file::bounded_file::{self, Kind};
use tactile_infer::Views;
use tactile_infer::safefile::write_whole;

use crate::error::{Error, Result};
use crate::evaluate::{Outcome, Scored};
use crate::origins::Origins;
use crate::result::{
    Choice, Evaluation, Inference, Method, ModelRecord, Poses, Row, SCHEMA, Stopping, is_one, is_zero, one,
};
use crate::summary::{self, Label};
use tactile_filter::EpisodeConfig;
use tactile_filter::budget::Speeds;

/// The value of [`Episodes::schema`].
pub const EPISODES_SCHEMA: &str = "tactile-filter/episodes/1";

/// Episodes, one after the other, of every way of inferring that an evaluation compares.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Episodes {
    /// [`EPISODES_SCHEMA`].
    pub schema: String,
    /// What was evaluated: the same in every shard.
    pub setup: Setup,
    /// The episodes that are here, of all of the setup's.
    pub episodes: Range<usize>,
    /// Threads that worked.
    pub n_threads: usize,
    /// The command line that made this.
    pub command: String,
    /// How long what the robot does takes.
    #[serde(default)]
    pub speeds: Speeds,
    /// What the first touch alone finds.
    pub singles: Vec<Single>,
    /// Each way of inferring.
    pub runs: Vec<RunResult>,
}

/// What was evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Name of the scene.
    pub scene: String,
    /// Names of its parts.
    pub parts: Vec<String>,
    /// Parts that each hole may be of.
    pub n_classes: usize,
    /// Episodes in all.
    pub n_episodes: usize,
    /// Seeds of the episodes.
    pub seeds: Vec<u64>,
    /// Prints of each part that the episodes take turns with.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub n_prints: usize,
    /// Touches of each.
    pub n_touches: usize,
    /// Where holes are touched.
    pub poses: Poses,
    /// Holes of a run that were named with confidence before each episode.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub n_earlier: usize,
    /// Standard deviations, mm and degrees, to which each hole's pose was known before it was touched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_known_to: Option<[f64; 2]>,
    /// Whether each hole's own part was taken out of the bank.
    pub absent: bool,
    /// Whether the holes were recorded; else they were simulated.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub recorded: bool,
    /// The parts that were recorded, where these are some of the bank's only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub recorded_parts: Vec<String>,
    /// Which side was touched.
    #[serde(default, skip_serializing_if = "Side::is_hole")]
    pub side: Side,
    /// What the bank's views are of.
    #[serde(default, skip_serializing_if = "Views::is_pegs")]
    pub views: Views,
    /// Limit on each choice of a touch, ms.
    pub choose_ms: Option<f64>,
    /// The model.
    pub model: ModelRecord,
    /// Checksum of the bank's rows.
    pub bank_sha256: String,
    /// Checksum of what judged the touches' maps, where something did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verifier_sha256: Option<String>,
    /// Device of the network.
    pub device: String,
}

/// A nearest neighbour of the first touch of each episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Single {
    /// By what.
    pub method: Method,
    /// Whether the recorded pictures were turned inside out first.
    pub inside_out: bool,
    /// One for each episode.
    pub scored: Vec<Scored>,
}

/// One way of inferring and choosing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunResult {
    /// What it is.
    pub label: Label,
    /// Its settings.
    pub config: EpisodeConfig,
    /// One for each episode.
    pub outcomes: Vec<Outcome>,
}

impl Episodes {
    /// Reads a shard.
    pub fn load(path: &Path) -> Result<Self> {
        let text = bounded_file::read_to_string(path, Kind::EPISODES)?;
        let shard: Self = serde_json::from_str(&text)
            .map_err(|e| Error::invalid(path.display().to_string(), "a shard of an evaluation", e.to_string()))?;
        let n = shard.episodes.len();
        let lengths = shard.singles.iter().map(|single| single.scored.len());
        let lengths = lengths.chain(shard.runs.iter().map(|run| run.outcomes.len()));
        match (shard.schema == EPISODES_SCHEMA, lengths.into_iter().find(|length| *length != n)) {
            (false, _) => Err(Error::invalid(path.display().to_string(), EPISODES_SCHEMA, shard.schema)),
            (_, Some(got)) => {
                Err(Error::invalid(path.display().to_string(), format!("{n} episodes of each kind"), got.to_string()))
            }
            _ => Ok(shard),
        }
    }

    /// Writes a shard, whole or not at all.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_vec(self).map_err(|e| Error::invalid("shard", "JSON", e.to_string()))?;
        Ok(write_whole(path, &text)?)
    }

    /// Whether another shard is of the same evaluation: setup and ways alike.
    pub fn is_of(&self, other: &Self) -> bool {
        let ways = |of: &Self| of.runs.iter().map(|run| (run.label, run.config)).collect::<Vec<_>>();
        let singles =
            |of: &Self| of.singles.iter().map(|single| (single.method, single.inside_out)).collect::<Vec<_>>();
        self.setup == other.setup && ways(self) == ways(other) && singles(self) == singles(other)
    }

    /// Puts shards together, given in any order; each with the file that it came from.
    ///
    /// # Errors
    /// None given, shards of different evaluations, an episode twice or not at all.
    pub fn merge(mut shards: Vec<(PathBuf, Self)>) -> Result<Self> {
        shards.sort_by_key(|(_, shard)| (shard.episodes.start, shard.episodes.end));
        let mut shards = shards.into_iter();
        let Some((first, mut whole)) = shards.next() else {
            return Err(Error::invalid("merge", "at least one shard", "none"));
        };
        let gap = |path: &Path, from: usize, to: usize| {
            Error::invalid(
                path.display().to_string(),
                format!("a shard that begins with episode {from}"),
                to.to_string(),
            )
        };
        if whole.episodes.start != 0 {
            return Err(gap(&first, 0, whole.episodes.start));
        }
        for (path, shard) in shards {
            if !whole.is_of(&shard) {
                let expected = format!("a shard of the evaluation of {}", first.display());
                return Err(Error::invalid(path.display().to_string(), expected, "one of another"));
            }
            if shard.episodes.start != whole.episodes.end {
                return Err(gap(&path, whole.episodes.end, shard.episodes.start));
            }
            whole.episodes.end = shard.episodes.end;
            whole.singles.iter_mut().zip(shard.singles).for_each(|(to, from)| to.scored.extend(from.scored));
            whole.runs.iter_mut().zip(shard.runs).for_each(|(to, from)| to.outcomes.extend(from.outcomes));
        }
        if whole.episodes.end != whole.setup.n_episodes {
            let got = format!("the first {}", whole.episodes.end);
            return Err(Error::invalid("merge", format!("all {} episodes", whole.setup.n_episodes), got));
        }
        Ok(whole)
    }

    /// SHA-256 of what each episode came to, without the times: the same however the work was divided.
    pub fn checksum(&self) -> Result<String> {
        let mut hash = Sha256::new();
        let runs = self.runs.iter().map(|run| run.outcomes.iter().map(|o| (o.part, &o.scored)).collect::<Vec<_>>());
        let all = (&self.setup, &self.singles, runs.collect::<Vec<_>>());
        hash.update(serde_json::to_vec(&all).map_err(|e| Error::invalid("evaluation", "JSON", e.to_string()))?);
        Ok(format!("{:x}", hash.finalize()))
    }

    /// The figures of the first touch alone.
    pub fn single_rows(&self, inside_out: bool) -> Vec<Row> {
        let label =
            |method| Label { method, inference: Inference::None, action: Choice::None, poses: self.setup.poses };
        let shown = self.singles.iter().filter(|single| single.inside_out == inside_out);
        let origins = self.origins();
        shown.map(|single| summary::row(label(single.method), 1, &single.scored, &origins)).collect()
    }

    /// The origins of the episodes, which are the same in each run.
    fn origins(&self) -> Origins {
        self.runs.first().map_or_else(Origins::default, |run| Origins::of(&run.outcomes))
    }

    /// All figures. Fails where there is no way of inferring.
    pub fn evaluation(&self) -> Result<Evaluation> {
        let Some(lead) = self.runs.first() else {
            return Err(Error::invalid("--engines and --actions", "at least one of each", "none"));
        };
        let setup = &self.setup;
        let of_run = |run: &RunResult| summary::rows(run.label, &run.outcomes);
        let stops: Vec<_> =
            self.runs.iter().map(|run| summary::stops(run.label, &run.outcomes, &run.config, &self.speeds)).collect();
        let others = self.runs[1..]
            .iter()
            .filter(|run| run.label.inference == lead.label.inference && run.label.action != lead.label.action);
        let compare = |run: &RunResult| summary::compare((lead.label, &lead.outcomes), (run.label, &run.outcomes));
        Ok(Evaluation {
            schema: SCHEMA.into(),
            scene: setup.scene.clone(),
            n_classes: setup.n_classes,
            n_episodes: setup.n_episodes,
            seeds: setup.seeds.clone(),
            n_prints: setup.n_prints,
            distinct_first_views: self.origins().distinct_first_views(),
            absent: setup.absent,
            n_earlier: setup.n_earlier,
            recorded: setup.recorded,
            recorded_parts: setup.recorded_parts.clone(),
            side: setup.side,
            views: setup.views,
            model: setup.model.clone(),
            device: setup.device.clone(),
            n_threads: self.n_threads,
            rows: self.single_rows(false).into_iter().chain(self.runs.iter().flat_map(of_run)).collect(),
            stopping: Stopping {
                mean_touches: stops[0].mean_touches,
                confident_and_wrong: stops[0].confident_and_wrong,
            },
            latency_ms: summary::latency(&lead.outcomes),
            stops,
            comparisons: others.flat_map(compare).collect(),
            reliability: summary::reliability(&lead.outcomes),
            parts: if setup.absent { Vec::new() } else { summary::parts(&setup.parts, &lead.outcomes) },
            strangers: if setup.absent {
                summary::strangers(&setup.parts, &lead.outcomes, &lead.config)
            } else {
                Vec::new()
            },
            command: Some(self.command.clone()),
            promise: None,
            checksum: Some(self.checksum()?),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shard(episodes: Range<usize>) -> Episodes {
        let scored =
            |i: usize| Scored { right: !i.is_multiple_of(3), probability: 0.1 + 0.01 * i as f64, ..Scored::default() };
        let outcome = |i| Outcome { part: i % 2, scored: vec![scored(i), scored(i + 1)], ..Outcome::default() };
        let label =
            Label { method: Method::Filter, inference: Inference::Exact, action: Choice::Random, poses: Poses::OnGrid };
        Episodes {
            schema: EPISODES_SCHEMA.into(),
            setup: Setup {
                scene: "s".into(),
                parts: vec!["A".into(), "B".into()],
                n_classes: 2,
                n_episodes: 10,
                seeds: vec![1],
                n_prints: 1,
                n_earlier: 0,
                n_touches: 2,
                poses: Poses::OnGrid,
                absent: false,
                recorded: false,
                recorded_parts: Vec::new(),
                side: Side::Hole,
                views: Views::Pegs,
                choose_ms: None,
                start_known_to: None,
                model: ModelRecord { name: "m".into(), sha256: "ab".into(), parameters: 7, input_px: [8, 6] },
                bank_sha256: "cd".into(),
                verifier_sha256: None,
                device: "flex".into(),
            },
            n_threads: 1,
            command: format!("{episodes:?}"),
            speeds: Speeds::default(),
            singles: vec![Single {
                method: Method::Moco,
                inside_out: false,
                scored: episodes.clone().map(scored).collect(),
            }],
            runs: vec![RunResult {
                label,
                config: EpisodeConfig::paper(),
                outcomes: episodes.clone().map(outcome).collect(),
            }],
            episodes,
        }
    }

    fn merge(parts: Vec<Episodes>) -> Result<Episodes> {
        let named = parts.into_iter().enumerate().map(|(i, part)| (PathBuf::from(format!("shard-{i}")), part));
        Episodes::merge(named.collect())
    }

    #[test]
    fn shards_in_any_order_come_to_what_one_run_came_to() {
        let folder = tempfile::tempdir().unwrap();
        let saved = [5..10, 0..3, 3..5].map(|episodes| {
            let path = folder.path().join(format!("{episodes:?}"));
            shard(episodes).save(&path).unwrap();
            let loaded = Episodes::load(&path).unwrap();
            (path, loaded)
        });
        let (merged, single) = (Episodes::merge(saved.into()).unwrap(), shard(0..10));
        assert_eq!(merged.checksum().unwrap(), single.checksum().unwrap());
        assert_eq!(merged.evaluation().unwrap().rows, single.evaluation().unwrap().rows);
        assert_eq!((merged.runs, merged.singles), (single.runs, single.singles));
    }

    #[test]
    fn a_checksum_is_of_what_was_found_and_not_of_how_long_it_took() {
        let (mut slow, mut other) = (shard(0..10), shard(0..10));
        slow.runs[0].outcomes[0].times.push(crate::evaluate::StageTimes { encode: 9.0, ..Default::default() });
        other.runs[0].outcomes[0].scored[1].xy_mm += 1e-15;
        let checksum = shard(0..10).checksum().unwrap();
        assert_eq!(slow.checksum().unwrap(), checksum);
        assert_ne!(other.checksum().unwrap(), checksum);
    }

    #[test]
    fn one_print_is_not_noted_and_more_are_another_evaluation() {
        let (one, mut three) = (shard(0..10), shard(0..10));
        let text = serde_json::to_string(&one).unwrap();
        assert!(!text.contains("print") && serde_json::from_str::<Episodes>(&text).unwrap() == one);
        three.setup.n_prints = 3;
        three.runs[0].outcomes[4].print = 1;
        assert_ne!(three.checksum().unwrap(), one.checksum().unwrap());
        assert_eq!(serde_json::from_value::<Episodes>(serde_json::to_value(&three).unwrap()).unwrap(), three);
        assert!(!three.is_of(&one) && three.evaluation().unwrap().n_prints == 3);
    }

    #[test]
    fn what_is_missing_twice_or_foreign_is_named() {
        let error = |parts| merge(parts).unwrap_err().to_string();
        assert_eq!(error(vec![]), "merge: expected at least one shard, got none");
        assert!(error(vec![shard(0..3), shard(5..10)]).contains("begins with episode 3, got 5"));
        assert!(error(vec![shard(0..6), shard(5..10)]).contains("begins with episode 6, got 5"));
        assert!(error(vec![shard(2..10)]).contains("shard-0: expected a shard that begins with episode 0"));
        assert_eq!(error(vec![shard(0..9)]), "merge: expected all 10 episodes, got the first 9");
        let mut foreign = shard(5..10);
        foreign.runs[0].config.settings.seed = 9;
        assert!(error(vec![shard(0..5), foreign]).contains("shard-1: expected a shard of the evaluation of shard-0"));
    }

    #[test]
    fn a_file_that_is_no_shard_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shard");
        std::fs::write(&path, "{\"schema\": 1}").unwrap();
        assert!(Episodes::load(&path).unwrap_err().to_string().contains("a shard of an evaluation"));
        let mut short = shard(0..10);
        short.runs[0].outcomes.pop();
        short.save(&path).unwrap();
        assert!(Episodes::load(&path).unwrap_err().to_string().contains("expected 10 episodes of each kind, got 9"));
    }
}
