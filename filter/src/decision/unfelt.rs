//! What is left to feel of the part that is named: a stranger may have all that was felt in common with it.
//!
//! In: the bank's map of the part, the touches, where they are on it. Out: the places of its outline that no touch showed. It must not
//! know the candidates of the next touch.

use tactile_data::pose::se2::Se2;
use tactile_infer::maps::align::Drawing;
use tactile_infer::maps::coverage::{View, views};

use crate::decision::verdict::Asked;

/// More places of an outline are thinned: a candidate shows as large a share of them.
const MOST_PLACES: usize = 128;

/// The rest of an outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Unfelt {
    /// Places on it, in the frame of the first touch, mm.
    pub places_mm: Vec<[f64; 2]>,
    /// What a touch shows, mm.
    pub view_mm: [f64; 2],
    /// The probability of a stranger by what was felt.
    pub none: f64,
}

impl Unfelt {
    /// What a touch at a pose in the first one's frame is expected to tell of whether the part is there, nats. A stranger differs at some
    /// place of the rest, each as likely, and the touch tells whether that is among what it shows: mutual information.
    pub fn nats(&self, first_from_sensor: &Se2) -> f64 {
        let view = View::of(first_from_sensor, self.view_mm);
        let n_shown = self.places_mm.iter().filter(|place| view.shows(**place)).count();
        let shown = n_shown as f64 / self.places_mm.len().max(1) as f64;
        entropy(self.none * shown) - self.none * entropy(shown)
    }
}

/// The entropy of a coin that falls on one side with a probability, nats.
fn entropy(p: f64) -> f64 {
    let term = |p: f64| if p > 0.0 { -p * p.ln() } else { 0.0 };
    term(p) + term(1.0 - p)
}

impl Asked<'_> {
    /// What is left to feel of the named part, where it is as probable as naming it asks for and only a stranger is left to doubt; `None`
    /// without maps, and where all of it was felt.
    pub(crate) fn unfelt(self) -> Option<Unfelt> {
        let Self { config, bank, .. } = self;
        if bank.verifier().is_none() || config.settings.false_accept.is_none() {
            return None;
        }
        let named = self.candidates();
        if named.probability <= config.settings.stop_probability || named.placed.verified.is_none() {
            return None;
        }
        let presence = named.presence?;
        let drawings: Vec<Drawing<'_>> = self.drawn().iter().map(|touch| touch.drawing).collect();
        let (view_mm, views) = (drawings.last()?.map.view_mm, views(&drawings, &Se2::IDENTITY));
        let first_from_part = named.placed.part_from_first.inverse();
        let mosaic = bank.mosaics()?.of(named.part, self.side());
        let places = mosaic.outline_mm().iter().map(|place| first_from_part.apply(*place));
        let places: Vec<[f64; 2]> = places.filter(|place| !views.iter().any(|view| view.shows(*place))).collect();
        let places_mm: Vec<[f64; 2]> =
            places.iter().step_by(places.len().div_ceil(MOST_PLACES).max(1)).copied().collect();
        (!places_mm.is_empty()).then(|| Unfelt { places_mm, view_mm, none: presence.none() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_what_the_table_of_both_outcomes_has() {
        // Half of the rest is within 2 mm of the first touch, half 20 mm away.
        let places_mm = vec![[1.0, 0.0], [0.0, 1.5], [20.0, 0.0], [20.0, 1.0]];
        let unfelt = Unfelt { places_mm, view_mm: [18.6, 14.3], none: 0.25 };
        let of = |share: f64| {
            // Stranger or not, shown otherwise or not: the sum of p ln(p / product of its margins).
            let told = 0.25 * share;
            let table = [(told, 0.25, told), (0.25 - told, 0.25, 1.0 - told), (0.75, 0.75, 1.0 - told)];
            table
                .into_iter()
                .map(|(p, a, b): (f64, f64, f64)| if p > 0.0 { p * (p / (a * b)).ln() } else { 0.0 })
                .sum::<f64>()
        };
        for (pose, share) in
            [(Se2::IDENTITY, 0.5), (Se2::from_degrees(10.0, 0.0, 90.0), 0.0), (Se2::from_degrees(10.5, 0.0, 0.0), 0.0)]
        {
            assert!((unfelt.nats(&pose) - of(share)).abs() < 1e-12, "{pose:?}");
        }
        let all = Unfelt { view_mm: [60.0, 40.0], ..unfelt };
        assert!((all.nats(&Se2::IDENTITY) - of(1.0)).abs() < 1e-12 && (of(1.0) - entropy(0.25)).abs() < 1e-12);
    }
}
