//! What is odd about the parts, sides and times of touches.

use std::collections::{BTreeMap, HashMap};

use super::{Finding, Kind, is_continued, named};
use crate::dataset::touch::{Side, Touch};

/// Numbers of touches may differ by this share of their median, and by one: some presses fail, and the number of pairs
/// is not always a multiple of the number of boards. A session that was left out makes more.
const UNEQUAL_SHARE: f64 = 0.1;

/// Parts with touches of holes alone or of pegs alone, in a dataset that has both. A dataset of one side is meant so,
/// as a bank is.
pub(super) fn missing_sides(touches: &[Touch]) -> Vec<Finding> {
    let mut sides: BTreeMap<&str, [bool; 2]> = BTreeMap::new();
    for touch in touches {
        if let (Some(part), Some(side)) = (&touch.part, touch.side) {
            sides.entry(part).or_default()[usize::from(side == Side::Peg)] = true;
        }
    }
    let without = |which: usize| -> Vec<&str> {
        sides.iter().filter(|(_, has)| has[1 - which] && !has[which]).map(|(part, _)| *part).collect()
    };
    let (no_hole, no_peg) = (without(0), without(1));
    if no_hole.len() == sides.len() || no_peg.len() == sides.len() {
        return Vec::new();
    }
    let finding = |parts: &[&str], has: &str, lacks: &str| {
        (!parts.is_empty()).then(|| Finding {
            kind: Kind::MissingSide,
            message: format!("{} part(s) with {has} and without {lacks}: {}", parts.len(), listed(parts)),
            frames: Vec::new(),
        })
    };
    [finding(&no_peg, "holes", "pegs"), finding(&no_hole, "pegs", "holes")].into_iter().flatten().collect()
}

/// Names in a row, the first of them where there are many.
fn listed(parts: &[&str]) -> String {
    /// Parts named before it says only that there are more.
    const MAX_PARTS: usize = 12;
    let more = if parts.len() > MAX_PARTS { ", ..." } else { "" };
    format!("{}{more}", parts[..parts.len().min(MAX_PARTS)].join(", "))
}

/// Parts and sides that were touched more often than others.
pub(super) fn unequal_numbers(touches: &[Touch]) -> Option<Finding> {
    let mut numbers: BTreeMap<(&str, Side), usize> = BTreeMap::new();
    for touch in touches.iter().filter(|touch| !is_continued(touch)) {
        if let (Some(part), Some(side)) = (&touch.part, touch.side) {
            *numbers.entry((part, side)).or_default() += 1;
        }
    }
    let mut sorted: Vec<usize> = numbers.values().copied().collect();
    sorted.sort_unstable();
    let median = *sorted.get(sorted.len() / 2)?;
    let ((fewest_of, fewest), (most_of, most)) =
        (numbers.iter().min_by_key(|(_, n)| **n)?, numbers.iter().max_by_key(|(_, n)| **n)?);
    if (most - fewest) as f64 <= (UNEQUAL_SHARE * median as f64).max(1.0) {
        return None;
    }
    let message = format!(
        "touches of a part and side are unequal in number: {fewest} of {} {}, {most} of {} {}, half of them {median} \
         or more",
        fewest_of.0, fewest_of.1, most_of.0, most_of.1
    );
    Some(Finding { kind: Kind::UnequalTouches, message, frames: Vec::new() })
}

/// Frames earlier than the one before them in their episode.
pub(super) fn times_that_go_back(touches: &[Touch]) -> Option<Finding> {
    let mut latest: HashMap<Option<&str>, f64> = HashMap::new();
    let mut frames = Vec::new();
    let mut most_s = 0.0_f64;
    for (frame, touch) in touches.iter().enumerate() {
        let Some(time_s) = touch.time_s else { continue };
        if let Some(before_s) = latest.insert(touch.episode.as_deref(), time_s)
            && time_s < before_s
        {
            frames.push(frame);
            most_s = most_s.max(before_s - time_s);
        }
    }
    let message =
        format!("times go back {} time(s), by up to {most_s:.3} s: at frames {}", frames.len(), named(&frames));
    (!frames.is_empty()).then_some(Finding { kind: Kind::TimesGoBack, message, frames })
}
