//! Real presses next to simulated ones of the same shape, pose, depth and light.

use serde_json::{Value, json};

use super::bench::Bench;
use crate::error::{Error, Result};
use crate::json::{entries, number, numbers};

/// A real press and how to simulate it.
pub struct Press {
    /// The real picture, as a word of a command line.
    pub picture: String,
    /// The part, the pose, the depth and the sensor, as words of `tactile-data render`.
    pub render: String,
}

/// What a set of presses has in common.
pub struct Views<'a> {
    /// A name for the files that are made.
    pub name: &'a str,
    /// The picture at rest, as a word.
    pub rest: &'a str,
    /// Width and height of what a frame shows, mm.
    pub view_mm: [f64; 2],
    /// A calibration file of the light; a Mini's without.
    pub calibration: Option<&'a str>,
}

/// How near presses and their twins come.
#[derive(Default)]
pub struct Twins {
    /// Cosine of each press with its twin.
    cosines: Vec<f64>,
    /// Mean absolute difference from rest farther than 4 mm from contact, counts: real, simulated.
    far_counts: Vec<[f64; 2]>,
}

impl Twins {
    /// Renders the twin of each press and compares the two.
    pub fn of(bench: &Bench<'_>, views: &Views<'_>, presses: &[Press]) -> Result<Self> {
        let Views { name, rest, view_mm: [x, y], calibration } = views;
        let mut far_counts = Vec::new();
        let mut pictures = Vec::new();
        for (n, Press { picture, render }) in presses.iter().enumerate() {
            let twin = format!("{name}-{n:02}.png");
            bench
                .run("tactile-data", &format!("render {render} --no-contact {rest} --fidelity camera --out {twin}"))?;
            bench.run("tactile-data", &format!("render {render} --fidelity geometry --out {name}-contact.png"))?;
            let compared = bench.json(
                "tactile-data",
                &format!(
                    "compare {picture} {twin} --no-contact {rest} {rest} \
                     --contact {name}-contact.png --field-of-view-mm {x} {y}"
                ),
            )?;
            let [real, simulated] = [0, 1].map(|side| number(&compared, &format!("/far_counts/{side}")));
            far_counts.push([real?, simulated?]);
            pictures.extend([picture.clone(), twin]);
        }
        let light = calibration.map_or(String::new(), |file| format!(" --calibration {file}"));
        let line = format!("embed {} --model MODEL --side peg --no-contact {rest}{light}", pictures.join(" "));
        let embedded = bench.json("tactile-infer", &line)?;
        let rows = entries(&embedded, "/images")?.iter().map(|row| numbers(row, "/embedding"));
        let rows = rows.collect::<Result<Vec<_>>>()?;
        if rows.len() != pictures.len() {
            return Err(Error::invalid("embed", format!("{} rows", pictures.len()), rows.len().to_string()));
        }
        let cosine = |pair: &[Vec<f64>]| pair[0].iter().zip(&pair[1]).map(|(a, b)| a * b).sum();
        Ok(Self { cosines: rows.chunks_exact(2).map(cosine).collect(), far_counts })
    }

    /// Both together.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.cosines.extend(other.cosines);
        self.far_counts.extend(other.far_counts);
        self
    }

    /// What was measured, in words.
    pub fn lines(&self) -> Vec<[String; 2]> {
        let mut sorted = self.cosines.clone();
        sorted.sort_by(f64::total_cmp);
        let least = sorted.first().copied().unwrap_or(f64::NAN);
        let middle = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
        let [real, simulated] = self.far();
        vec![
            [
                "cosine of a real press with its simulated twin".into(),
                format!("mean {:.3}, median {middle:.3}, least {least:.3}, of {}", mean(&self.cosines), sorted.len()),
            ],
            [
                "change more than 4 mm from contact, mean absolute".into(),
                format!("real {real:.2} counts, simulated {simulated:.2}"),
            ],
        ]
    }

    /// For programs.
    pub fn json(&self) -> Value {
        json!({ "cosines": self.cosines, "mean_cosine": mean(&self.cosines), "far_counts": self.far() })
    }

    /// Mean over presses: real, simulated.
    fn far(&self) -> [f64; 2] {
        [0, 1].map(|side| mean(&self.far_counts.iter().map(|counts| counts[side]).collect::<Vec<_>>()))
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
