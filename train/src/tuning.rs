//! How well one touch identifies parts that training never sees: the accuracy that matters to the filter.

use std::collections::BTreeSet;

use rayon::prelude::*;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_infer::Model;
use tactile_infer::bank::recorded::{BankPoses, bank_of_dataset, parts_on_grid, tactile_images};
use tactile_infer::calibration::matching::{best, recorded_cosines};

use crate::error::{Error, Result};

/// At most this many holes are matched, evenly spread over the dataset.
const MAX_HOLES: usize = 1_000;

/// Parts that are not trained on: pegs on a grid of poses, and holes of the same parts.
#[derive(Debug)]
pub struct Tuning<'a> {
    pegs: &'a Dataset,
    holes: &'a Dataset,
    chosen: Vec<usize>,
    n_parts: usize,
}

impl<'a> Tuning<'a> {
    /// Takes datasets such as `tactile-data generate --scene alphabet-small-dev --sides peg` (and `hole`) makes.
    ///
    /// # Errors
    /// Pegs that fill no grid, no holes of known part, or holes of a part without pegs.
    pub fn new(pegs: &'a Dataset, holes: &'a Dataset) -> Result<Self> {
        let parts = parts_on_grid(pegs, BankPoses::default())?;
        let holes_of_parts: Vec<usize> = (0..holes.len())
            .filter(|index| holes.touch(*index).side == Some(Side::Hole) && holes.touch(*index).part.is_some())
            .collect();
        if holes_of_parts.is_empty() {
            let what = format!("--tune: holes {}", holes.meta().name);
            return Err(Error::invalid(what, "holes of known part", "none"));
        }
        let without_peg =
            holes_of_parts.iter().filter_map(|i| holes.touch(*i).part.as_ref()).find(|p| !parts.contains(p));
        if let Some(without_peg) = without_peg {
            let what = format!("--tune: holes {}", holes.meta().name);
            return Err(Error::invalid(what, format!("parts of {}", parts.join(", ")), without_peg));
        }
        let n = holes_of_parts.len().min(MAX_HOLES);
        let chosen = (0..n).map(|i| holes_of_parts[i * holes_of_parts.len() / n]).collect();
        Ok(Self { pegs, holes, chosen, n_parts: parts.len() })
    }

    /// Refuses parts that training sees: their accuracy would say nothing about others.
    pub fn check_unseen(&self, training: &Dataset) -> Result<()> {
        let held_out: BTreeSet<&String> = training.meta().held_out.iter().collect();
        let seen: BTreeSet<&String> =
            training.touches().iter().filter_map(|t| t.part.as_ref()).filter(|p| !held_out.contains(p)).collect();
        let parts: BTreeSet<&String> = self.holes.touches().iter().filter_map(|touch| touch.part.as_ref()).collect();
        match parts.intersection(&seen).next() {
            Some(part) => {
                let what = format!("--tune: holes {}", self.holes.meta().name);
                Err(Error::invalid(what, "parts that are not trained on", format!("'{part}'")))
            }
            None => Ok(()),
        }
    }

    /// The accuracy by chance, 0..=1.
    pub fn chance(&self) -> f64 {
        1.0 / self.n_parts as f64
    }

    /// Images embedded for one accuracy.
    pub fn n_images(&self) -> usize {
        self.pegs.len() + self.chosen.len()
    }

    /// Share of holes whose nearest peg by cosine, of all parts at all poses, is of the right part, 0..=1.
    pub fn accuracy(&self, model: &Model) -> Result<f64> {
        let bank = bank_of_dataset(model, self.pegs, BankPoses::default(), &|_, _| ())?.bank;
        let background = model.background_of(self.holes)?;
        let mut n_right = 0;
        for frames in self.chosen.chunks(256) {
            let queries = model.embed_holes(&tactile_images(&background, self.holes, frames)?)?;
            let is_right = |(query, frame): (&[f32], &usize)| {
                let row = best(recorded_cosines(&bank, query).into_iter());
                Some(&bank.parts()[row / bank.grid().len()]) == self.holes.touch(*frame).part.as_ref()
            };
            let queries = queries.par_chunks_exact(bank.dim()).zip(frames);
            n_right += queries.filter(|(query, frame)| is_right((query, frame))).count();
        }
        Ok(n_right as f64 / self.chosen.len() as f64)
    }
}
