//! One rule of choosing touches against another on the same holes: the paired difference.

use maud::{Markup, html};

use super::series::{choice, choice_class_and_marker};
use crate::page::curves::{Line, Point, chart, legend};
use crate::page::numbers::{capital, difference, p_value};
use crate::page::shell::{Section, figure};
use crate::page::table::by_touches;
use crate::result::{Choice, Comparison, Evaluation, Inference};
use crate::statistics::mcnemar::{LEAST_DISCORDANT, Paired};

/// The comparisons of an evaluation as a plot and a table. Nothing where nothing was compared.
pub fn section(evaluation: &Evaluation) -> Option<Section> {
    let mut all: Vec<&Comparison> = evaluation.comparisons.iter().collect();
    all.sort_by_key(|c| (c.inference, c.action, c.against, c.n_touches));
    let pairs: Vec<&[&Comparison]> = all.chunk_by(|a, b| pair(a) == pair(b)).collect();
    if pairs.is_empty() {
        return None;
    }
    let lines: Vec<Line> = pairs.iter().map(|pair| line(pair)).collect();
    let columns: Vec<(String, &[&Comparison])> =
        pairs.iter().map(|pair| (format!("minus {}", choice(pair[0].against)), *pair)).collect();
    let charts = html! {
        (legend(&lines))
        div.charts.two {
            div { p { "Difference of right parts, points" } (chart("Paired difference", &lines, Some(range(&all)))) }
            (table(&columns))
        }
    };
    let body = html! {
        @for pair in &pairs { p { (verdict(pair)) } }
        (figure(charts, "Both rules touch the same holes, from the same first touch; after each number of touches, the accuracy \
            of the one minus that of the other, with the 95 % interval of the paired difference. Above zero the first rule is \
            better; where the interval contains zero, these episodes cannot decide. Clearly better is what chance explains in fewer             than 5 % of the cases: McNemar’s exact test of the holes that one rule alone names rightly (“12 against 3”), which takes             holes as independent. Each number of touches is tested alone."))
    };
    Some(Section::new("Choosing", "Does choosing the touch pay?", body))
}

/// A row for each number of touches, a column for each comparison.
pub(crate) fn table(columns: &[(String, &[&Comparison])]) -> Markup {
    let touches = |of: &&[&Comparison]| of.iter().map(|c| c.n_touches).collect();
    by_touches(columns, touches, |of, n| {
        html! {
            @if let Some(c) = of.iter().find(|c| c.n_touches == n) {
                (difference(c.difference, c.ci95))
                @if let Some(Paired { better, worse, p_value: p }) = c.paired {
                    small { (better) " against " (worse) ", " (p_value(p)) }
                }
            }
        }
    })
}

/// The differences as points of a curve.
pub(crate) fn points(comparisons: &[&Comparison]) -> Vec<Point> {
    comparisons.iter().map(|c| Point::percent(c.n_touches, c.difference, c.ci95)).collect()
}

/// What distinguishes one curve from another.
fn pair(c: &Comparison) -> (Inference, Choice, Choice) {
    (c.inference, c.action, c.against)
}

fn line(pair: &[&Comparison]) -> Line {
    let (class, marker) = choice_class_and_marker(pair[0].against);
    let label = format!("{} minus {}", choice(pair[0].action), choice(pair[0].against));
    Line { label, class: class.into(), marker, points: points(pair) }
}

/// Contains all intervals and zero, points.
pub(crate) fn range(all: &[&Comparison]) -> [f64; 2] {
    let bounds = all.iter().flat_map(|c| c.ci95).filter(|bound| bound.is_finite());
    // At least a few points either way, so that small differences look small.
    bounds.fold([-5.0, 5.0], |[low, high], bound| [low.min(100.0 * bound), high.max(100.0 * bound)])
}

/// After how many touches the one is better or worse than chance can explain, with the names of both.
fn verdict(pair: &[&Comparison]) -> Markup {
    html! { b { (capital(choice(pair[0].action))) " against " (choice(pair[0].against)) ":" } " " (clearly(pair)) "." }
}

/// After how many touches the one is better or worse than chance can explain, and where too few holes differ to tell.
pub(crate) fn clearly(pair: &[&Comparison]) -> String {
    let touches = |holds: &dyn Fn(&Comparison) -> bool| -> Vec<usize> {
        pair.iter().filter(|c| holds(c)).map(|c| c.n_touches).collect()
    };
    let after = |word: &str, found: &[usize]| match found {
        [] => format!("never clearly {word}"),
        [1] => format!("clearly {word} after 1 touch"),
        found => format!("clearly {word} after {} touches", runs(found)),
    };
    let better = after("better", &touches(&|c| is_clear(c) && c.difference > 0.0));
    let worse = after("worse", &touches(&|c| is_clear(c) && c.difference < 0.0));
    // The first touch is the same by either rule.
    let is_too_few = |c: &Comparison| c.n_touches > 1 && c.paired.is_some_and(|paired| paired.is_too_few());
    let too_few = match touches(&is_too_few).as_slice() {
        [] => String::new(),
        n => format!("; after {} touches fewer than {LEAST_DISCORDANT} holes differ, too few to tell", runs(n)),
    };
    format!("{better}, {worse}{too_few}")
}

/// Whether chance is unlikely; of files without a test by the interval.
fn is_clear(c: &Comparison) -> bool {
    c.paired.map_or(c.ci95[0] > 0.0 || c.ci95[1] < 0.0, |paired| paired.is_clear())
}

/// Ascending numbers, those that follow each other as a range.
fn runs(numbers: &[usize]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [first, .., last] => format!("{first}–{last}"),
        _ => run[0].to_string(),
    });
    runs.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::tests::published;
    use maud::Render;

    fn comparison(against: Choice, n_touches: usize, difference: f64, half: f64) -> Comparison {
        let ci95 = [difference - half, difference + half];
        let (inference, action) = (Inference::Exact, Choice::Information);
        Comparison { inference, action, against, n_touches, difference, ci95, paired: None }
    }

    #[test]
    fn what_chance_can_explain_is_not_called_better_or_worse() {
        let of = |n, difference| comparison(Choice::Random, n, difference, 0.0625);
        let all = [of(1, -0.25), of(2, 0.25), of(3, 0.125), of(4, 0.0), of(5, 0.125)];
        let text = verdict(&all.iter().collect::<Vec<_>>()).0;
        assert!(text.starts_with("<b>Most informative action against random action:"), "{text}");
        assert!(text.ends_with("clearly better after 2–3, 5 touches, clearly worse after 1 touch."), "{text}");
        assert!(verdict(&[&all[3]]).0.ends_with("never clearly better, never clearly worse."));
    }

    #[test]
    fn below_six_holes_that_differ_nothing_is_clear() {
        let of = |n_touches, better, worse| {
            let pairs = (0..better + worse).map(|i| if i < better { (true, false) } else { (false, true) });
            // The interval alone would call each of them clear.
            let difference = (better as f64 - worse as f64) / 500.0;
            Comparison { paired: Some(Paired::of(pairs)), ..comparison(Choice::Random, n_touches, difference, 1e-3) }
        };
        let all = [of(1, 9, 1), of(2, 4, 0), of(3, 0, 5), of(4, 1, 9), of(5, 9, 3)];
        assert_eq!(
            clearly(&all.iter().collect::<Vec<_>>()),
            "clearly better after 1 touch, clearly worse after 4 touches; after 2–3 touches fewer than 6 holes differ, too \
             few to tell"
        );
        let columns = [("minus".to_owned(), &[&all[1]][..])];
        assert!(table(&columns).0.contains("<small>4 against 0, p = 0.125</small>"), "{}", table(&columns).0);
    }

    #[test]
    fn each_pair_of_rules_has_its_curve_and_its_column() {
        let mut evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        assert!(section(&evaluation).is_none());
        let of = |against| (1..=3).map(move |n| comparison(against, n, -0.125, 0.25));
        evaluation.comparisons = of(Choice::Random).chain(of(Choice::Paper)).collect();
        let html = section(&evaluation).unwrap().render().0;
        assert_eq!(html.matches("<path class=\"band\"").count(), 2);
        assert_eq!(html.matches("−12.5<small>−37.5 to +12.5</small>").count(), 2 * 3);
    }

    #[test]
    fn the_axis_contains_every_interval_and_zero() {
        let all = [comparison(Choice::Random, 1, 0.25, 0.125), comparison(Choice::Random, 2, 0.5, 0.125)];
        assert_eq!(range(&all.iter().collect::<Vec<_>>()), [-5.0, 62.5]);
    }
}
