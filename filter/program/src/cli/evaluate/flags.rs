//! What the flags of `tactile-filter evaluate` leave open, and which of them do not go together.

use tactile_eval::{Error, Result};
use tactile_filter::choice::ActionRule;

use super::super::arguments::Engine;
use super::super::numbers::refuse_given;
use super::Evaluate;

impl Evaluate {
    /// The engines that are compared.
    pub(super) fn engines(&self) -> &[Engine] {
        if self.engines.is_empty() { &[Engine::Exact, Engine::Paper] } else { &self.engines }
    }

    /// The rules that are compared.
    pub(super) fn actions(&self) -> &[ActionRule] {
        const ALL: [ActionRule; 3] = [ActionRule::Information, ActionRule::Paper, ActionRule::Random];
        if self.actions.is_empty() { &ALL } else { &self.actions }
    }

    /// Whether episodes can be shown: one without its part has no truth to show, one of a few parts no map of all, and a
    /// shard's are shown nowhere.
    pub(super) fn has_stories(&self) -> bool {
        !self.absent && self.classes.is_none() && self.shard.is_none()
    }

    /// Refuses flags that would do nothing.
    pub(super) fn check_flags(&self) -> Result<()> {
        if !self.has_stories() && self.stories.is_some_and(|n| n > 0) {
            let got = "--shard, --absent or --classes, with which none is shown";
            return Err(Error::invalid("--stories", "all parts in one run", got));
        }
        let ways = [("--engines", !self.engines.is_empty()), ("--actions", !self.actions.is_empty())];
        self.budget.check_chosen(&ways, &self.numbers)?;
        self.numbers.refuse(&["seed"], "--seeds, from which each episode has its own", "one")?;
        self.numbers.check_engines(self.engines())?;
        let of_paper = [ActionRule::Paper];
        let has_paper = self.engines().contains(&Engine::Paper);
        if self.engines().iter().all(|engine| *engine == Engine::Paper) {
            refuse_given(&ways[1..], "an engine that takes a rule, exact or particle", "paper alone")?;
            return self.numbers.check_rules(&of_paper);
        }
        let rules = self.actions().iter().chain(of_paper.iter().filter(|_| has_paper)).copied().collect::<Vec<_>>();
        self.numbers.check_rules(&rules)
    }
}
