//! A bank of a scene before it learns to compare embeddings: it can learn from all of its parts, or without one of
//! them.
//!
//! A bank that only leaves out the rows of a part still knows it: its metric and expected matches were
//! learnt from that part's touches, too. A part that is to be a stranger is left out before anything is learnt. Every
//! part is touched once, however often one is left out.

use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;

use crate::bank::Bank;
use crate::bank::learn_from::Learning;
use crate::bank::metric::Metric;
use crate::bank::similarity::dot;
use crate::embedding::model::Model;
use crate::error::{Error, Result};

use super::SceneBank;
use super::matches::OwnTouches;

/// A bank that was made again has rows of at least this cosine with the rows of its file: formats of 1 byte a value
/// round to 0.9999, and touches with another seed are nearer than this in blank views alone.
const SAME_ROW: f32 = 0.999;

/// What a bank of a scene is before it learns, and the touches that it learns from.
#[derive(Debug)]
pub struct Learner {
    /// All parts, compared by the cosine alone, in f32.
    bank: Bank,
    touches: OwnTouches,
    learning: Learning,
}

impl Learner {
    /// Touches the parts of a bank that learnt nothing yet.
    ///
    /// # Errors
    /// A touch that cannot be made or seen.
    pub(super) fn new(
        model: &Model,
        bank: Bank,
        (simulator, parts): (&Simulator, &[usize]),
        learning: Learning,
    ) -> Result<Self> {
        let touches = OwnTouches::new(model, &bank, (simulator, parts), learning.seed)?;
        Ok(Self { bank, touches, learning })
    }

    /// The learner of a bank that learnt before, whose parts are touched again as they were: with its symmetries, its
    /// kind of views, its poses and its seed.
    ///
    /// # Errors
    /// A bank that does not say how it learnt, or that this scene does not give; a touch that cannot be made or seen.
    pub fn of_bank(
        model: &Model,
        bank: &Bank,
        scene: &Scene,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Self> {
        let Some(Learning { from, seed }) = bank.metric().and_then(Metric::learning) else {
            let expected = "one that says how it learnt to compare embeddings";
            let got = "one that does not: make it again from its scene with this version";
            return Err(Error::invalid("bank", expected, got));
        };
        if scene.part_names() != bank.parts() {
            let expected = format!("the parts of the scene {}, {}", scene.name, scene.part_names().join(" "));
            return Err(Error::invalid("bank", expected, bank.parts().join(" ")));
        }
        let scene = Scene { reach: Some(*bank.start()), ..scene.clone() };
        let again = SceneBank { model, scene: &scene, views: bank.views(), learn_from: from, seed };
        let Self { bank: plain, touches, learning } = again.learner(None, progress)?;
        let symmetries = (0..bank.parts().len()).map(|part| bank.symmetry(part)).collect();
        let learner = Self { bank: plain.with_symmetries(symmetries)?, touches, learning };
        learner.check(bank, &scene.name)?;
        Ok(learner)
    }

    /// The bank that learnt from all of its parts, its rows in f32.
    ///
    /// # Errors
    /// Values that leave the range of f32.
    pub fn whole(&self) -> Result<Bank> {
        let parts: Vec<usize> = (0..self.bank.parts().len()).collect();
        self.taught(self.bank.clone(), &parts, Some(self.learning))
    }

    /// The bank of the other parts that a part, by its index, taught nothing; its rows in f32.
    ///
    /// # Errors
    /// A part that the bank does not hold, or the only one that it holds.
    pub fn without(&self, part: usize) -> Result<Bank> {
        let others: Vec<usize> = (0..self.bank.parts().len()).filter(|other| *other != part).collect();
        self.taught(self.bank.without(part)?, &others, None)
    }

    /// A bank of some of the parts once it has learnt from them, and says how.
    fn taught(&self, bank: Bank, parts: &[usize], learning: Option<Learning>) -> Result<Bank> {
        let learnt = self.touches.of_parts(parts).learn(bank.dim(), self.learning.from.sides());
        let bank = bank.with_matches(learnt.matches)?;
        match (learnt.metric, learning) {
            (Some(metric), Some(learning)) => bank.with_metric(metric.with_learning(learning)),
            (Some(metric), None) => bank.with_metric(metric),
            (None, _) => Ok(bank),
        }
    }

    /// Refuses a bank of the same parts and model whose rows differ from the rows that it would have.
    fn check(&self, bank: &Bank, scene: &str) -> Result<()> {
        let whole = self.whole()?;
        let cosine = |row: usize| {
            let (mine, given) = (whole.row(row), bank.row(row));
            dot(&mine, &given) / (dot(&mine, &mine) * dot(&given, &given)).sqrt()
        };
        let odd =
            (0..whole.n_rows()).map(|row| (row, cosine(row))).find(|(_, cosine)| cosine.is_nan() || *cosine < SAME_ROW);
        match odd {
            Some((row, cosine)) => {
                let part = &bank.parts()[row / bank.grid().len()];
                let expected = format!("the one that the scene {scene} gives");
                let got = format!("another view of part {part} (cosine {cosine:.3}): its sensor or parts are others");
                Err(Error::invalid("bank", expected, got))
            }
            None => Ok(()),
        }
    }
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use super::*;
    use crate::bank::learn_from::LearnFrom;
    use crate::bank::simulated::tests::scene_and_model;
    use crate::bank::views::Views;
    use crate::embedding::precision::Precision;
    use tactile_data::scene::{Kit, Parts};

    /// A scene of other letters.
    fn of_letters(scene: &Scene, letters: &str) -> Scene {
        Scene { parts: Parts::Kit(Kit::of_letters(letters, 12.0, 16.0)), ..scene.clone() }
    }

    /// A bank of both sides that learns from both.
    fn bank_of<'a>(model: &'a Model, scene: &'a Scene) -> SceneBank<'a> {
        SceneBank { model, scene, views: Views::Both, learn_from: LearnFrom::Both, seed: 5 }
    }

    fn learner(model: &Model, scene: &Scene, letters: &str) -> Learner {
        bank_of(model, &of_letters(scene, letters)).learner(None, &|_, _| ()).unwrap()
    }

    #[test]
    fn a_part_left_out_taught_nothing_whatever_it_is() {
        let (scene, model) = scene_and_model();
        let known = learner(&model, &scene, "KLM");
        for (part, letters) in ["OLM", "KOM", "KLO"].into_iter().enumerate() {
            let other = learner(&model, &scene, letters);
            // The same to the bit: rows, metric, matches, symmetries, neighbours.
            assert_eq!(known.without(part).unwrap(), other.without(part).unwrap(), "{letters}");
            // To leave out its rows alone leaves what it taught.
            let [known, other] = [&known, &other].map(|of| of.whole().unwrap().without(part).unwrap());
            assert_ne!(known.metric(), other.metric(), "{letters}");
            assert_ne!(known.rows(), other.rows(), "{letters}");
            assert_ne!(known.matches(), other.matches(), "{letters}");
        }
        assert!(known.without(3).unwrap_err().to_string().contains("one of 3 parts"));
    }

    #[test]
    fn a_bank_without_its_last_part_is_the_one_that_never_had_it() {
        let (scene, model) = scene_and_model();
        let two = learner(&model, &scene, "KL");
        let afresh = two.taught(two.bank.clone(), &[0, 1], None).unwrap();
        assert!(afresh.metric().is_some());
        assert_eq!(learner(&model, &scene, "KLM").without(2).unwrap(), afresh);
    }

    #[test]
    fn a_bank_of_a_file_learns_again_and_other_scenes_are_refused() {
        let (scene, model) = scene_and_model();
        let made = of_letters(&scene, "KLM");
        let whole = bank_of(&model, &made).make(None, &|_, _| ()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bank");
        let kept = whole.with_precision(Precision::I8).unwrap().with_declared("L", Some(2)).unwrap();
        kept.save(&path).unwrap();
        let loaded = Bank::load(&path, &model).unwrap();
        assert_eq!(loaded, kept);
        // The scene says other poses than the bank has.
        let coarse = Scene {
            reach: made.reach.map(|reach| tactile_data::pose::grid::PoseGrid { xy_step_mm: 8.0, ..reach }),
            ..made
        };
        let again = |scene: &Scene| Learner::of_bank(&model, &loaded, scene, &|_, _| ());
        let learnt = again(&coarse).unwrap().without(0).unwrap();
        let expected = learner(&model, &scene, "KLM").without(0).unwrap().with_declared("L", Some(2)).unwrap();
        assert_eq!(learnt, expected);
        let error = |scene: &Scene| again(scene).unwrap_err().to_string();
        let other = error(&of_letters(&scene, "KLO"));
        assert!(other.contains("the parts of the scene") && other.contains("K L O, got K L M"), "{other}");
        let mut gel = coarse.clone();
        gel.sensor.gel_length_mm *= 2.0;
        assert!(error(&gel).contains("another view of part"), "{}", error(&gel));
        let nothing = SceneBank { learn_from: LearnFrom::Nothing, ..bank_of(&model, &coarse) };
        let plain = nothing.make(None, &|_, _| ()).unwrap();
        let refused = Learner::of_bank(&model, &plain, &coarse, &|_, _| ()).unwrap_err().to_string();
        assert!(refused.contains("says how it learnt"), "{refused}");
    }
}
