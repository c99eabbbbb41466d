//! Whether one touch more does harm: each number of touches against one less, on the same holes.

use maud::{Markup, html};

use super::series::{Series, series};
use crate::page::numbers::{p_value, touch_count};
use crate::result::{Evaluation, Method, Poses};
use crate::statistics::mcnemar::{LEAST_DISCORDANT, Paired};

/// For each way of inferring where it names clearly fewer parts than a touch before. Nothing where that was not counted.
pub fn steps(evaluation: &Evaluation) -> Markup {
    let all = [Poses::OnGrid, Poses::OffGrid].into_iter().flat_map(|poses| series(evaluation, poses));
    let ways: Vec<(Series<'_>, Vec<(usize, Paired)>)> = all
        .filter(|series| series.method == Method::Filter)
        .map(|series| {
            let step = |row: &&crate::result::Row| Some((row.n_touches, row.against_one_less?));
            let steps = series.rows.iter().filter_map(step).collect();
            (series, steps)
        })
        .filter(|(_, steps): &(_, Vec<_>)| !steps.is_empty())
        .collect();
    let n_steps: usize = ways.iter().map(|(_, steps)| steps.len()).sum();
    html! {
        @if n_steps > 0 {
            p { b { "Does one touch more do harm?" } " Right parts against one touch less, on the same holes:" }
            ul { @for (series, steps) in &ways { li { (series.label()) ": " (harm(steps)) "." } } }
            p.note {
                "Clearly: chance alone would split the holes that change so unevenly in fewer than 5\u{a0}% of the cases (McNemar’s "
                "test, exact and two-sided); with fewer than " (LEAST_DISCORDANT) " of them nothing can be clear. Each of the "
                (n_steps) " steps is tested alone, so that of 40 without harm one would be called clear; holes count as independent, "
                "though those of one part resemble each other."
            }
        }
    }
}

/// Where fewer are right than before.
fn harm(steps: &[(usize, Paired)]) -> String {
    let falls = |(_, paired): &&(usize, Paired)| paired.is_clear() && paired.worse > paired.better;
    let fall = |(n, paired): &(usize, Paired)| {
        let Paired { better, worse, p_value: p } = paired;
        format!("{} ({better} gained, {worse} lost, {})", touch_count(*n), p_value(*p))
    };
    let found: Vec<String> = steps.iter().filter(falls).map(fall).collect();
    if !found.is_empty() {
        return format!("clearly fewer after {}", found.join(", "));
    }
    let few = steps.iter().filter(|(_, paired)| paired.is_too_few()).count();
    let too_few = match few {
        0 => String::new(),
        n if n == steps.len() => format!("; at each step fewer than {LEAST_DISCORDANT} holes change, too few to tell"),
        n => format!("; at {n} of {} steps fewer than {LEAST_DISCORDANT} holes change, too few to tell", steps.len()),
    };
    format!("never clearly fewer{too_few}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::{Row, tests::published};

    fn shown(paired: &[(usize, usize)]) -> String {
        let mut evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        let template = evaluation.rows[0].clone();
        let right = |better: usize, worse: usize| {
            (0..better + worse).map(move |i| if i < better { (true, false) } else { (false, true) })
        };
        let row = |(n, (better, worse)): (usize, &(usize, usize))| {
            let against_one_less = Some(Paired::of(right(*better, *worse)));
            Row { n_touches: n, against_one_less, ..template.clone() }
        };
        evaluation.rows = (2..).zip(paired).map(row).collect();
        steps(&evaluation).0
    }

    #[test]
    fn harm_is_only_what_chance_does_not_explain() {
        let html = shown(&[(30, 2), (1, 9), (0, 5), (8, 9)]);
        assert!(html.contains("clearly fewer after 3 touches (1 gained, 9 lost, p = 0.021)."), "{html}");
        let html = shown(&[(30, 2), (0, 5), (8, 9)]);
        assert!(
            html.contains("never clearly fewer; at 1 of 3 steps fewer than 6 holes change, too few to tell."),
            "{html}"
        );
        let html = shown(&[(0, 5)]);
        assert!(html.contains("never clearly fewer; at each step fewer than 6 holes change"), "{html}");
        assert_eq!(shown(&[]), "");
    }
}
