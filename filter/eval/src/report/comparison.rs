//! One rule of choosing touches against another on the same holes: the paired difference.

use super::super::result::{Choice, Comparison, Evaluation, Inference};
use super::curves::{Line, Point, chart, legend_mark};
use super::series::{choice, choice_class_and_marker};
use super::shell::Section;
use super::signed;
use super::table::sortable;

/// The comparisons of an evaluation as a plot and a table. Nothing where nothing was compared.
pub fn section(evaluation: &Evaluation) -> Option<Section> {
    let mut all: Vec<&Comparison> = evaluation.comparisons.iter().collect();
    all.sort_by_key(|c| (c.inference, c.action, c.against, c.n_touches));
    let pairs: Vec<&[&Comparison]> = all.chunk_by(|a, b| pair(a) == pair(b)).collect();
    if pairs.is_empty() {
        return None;
    }
    let lines: Vec<Line> = pairs.iter().map(|pair| line(pair)).collect();
    let legend: String = lines
        .iter()
        .map(|line| format!("<li>{}{}</li>", legend_mark(&line.class, line.marker, true), line.label))
        .collect();
    let verdicts: String = pairs.iter().map(|pair| format!("<p>{}</p>\n", verdict(pair))).collect();
    let body = format!(
        r#"{verdicts}<figure><ul class="legend">{legend}</ul><div class="charts two"><div><p>Difference of right parts, points</p>{}</div>
{}</div>
<figcaption>Both rules touch the same holes, from the same first touch; after each number of touches, the accuracy of the one less that of the
other, with the 95 % interval of the paired difference. Above nought the first rule is better; where the interval holds
nought, these episodes cannot tell.</figcaption></figure>
"#,
        chart("Paired difference", &lines, Some(range(&all))),
        table(&pairs),
    );
    Some(Section::new("Choosing", "Does choosing the touch pay?", body))
}

/// What distinguishes one curve from another.
fn pair(c: &Comparison) -> (Inference, Choice, Choice) {
    (c.inference, c.action, c.against)
}

fn name(c: &Comparison) -> String {
    format!("{} less {}", choice(c.action), choice(c.against))
}

fn line(pair: &[&Comparison]) -> Line {
    let (class, marker) = choice_class_and_marker(pair[0].against);
    let point = |c: &&Comparison| Point {
        n_touches: c.n_touches,
        value: 100.0 * c.difference,
        interval: Some(c.ci95.map(|bound| 100.0 * bound)),
    };
    Line { label: name(pair[0]), class: class.into(), marker, points: pair.iter().map(point).collect() }
}

/// Holds all intervals and nought, points.
pub(crate) fn range(all: &[&Comparison]) -> [f64; 2] {
    let bounds = all.iter().flat_map(|c| c.ci95).filter(|bound| bound.is_finite());
    // At least a few points either way, so that small differences look small.
    bounds.fold([-5.0, 5.0], |[low, high], bound| [low.min(100.0 * bound), high.max(100.0 * bound)])
}

/// A row for each number of touches, a column for each pair of rules.
fn table(pairs: &[&[&Comparison]]) -> String {
    let names: Vec<String> = pairs.iter().map(|pair| format!("less {}", choice(pair[0].against))).collect();
    let heads: Vec<&str> = std::iter::once("Touches").chain(names.iter().map(String::as_str)).collect();
    let mut n_touches: Vec<usize> = pairs.iter().flat_map(|pair| pair.iter()).map(|c| c.n_touches).collect();
    n_touches.sort_unstable();
    n_touches.dedup();
    let cell = |pair: &&[&Comparison], n: usize| {
        let found = pair.iter().find(|c| c.n_touches == n);
        found.map_or(String::new(), |c| {
            let [low, high] = c.ci95.map(|bound| signed(100.0 * bound, 1));
            format!("{}<small>{low} to {high}</small>", signed(100.0 * c.difference, 1))
        })
    };
    let row = |n: &usize| std::iter::once(n.to_string()).chain(pairs.iter().map(|pair| cell(pair, *n))).collect();
    sortable(&heads, &n_touches.iter().map(row).collect::<Vec<_>>())
}

/// After how many touches the one is better or worse than chance can explain, with the names of both.
fn verdict(pair: &[&Comparison]) -> String {
    let (one, other) = (capital(choice(pair[0].action)), choice(pair[0].against));
    format!("<b>{one} against {other}:</b> {}.", clearly(pair))
}

/// After how many touches the one is better or worse than chance can explain.
pub(crate) fn clearly(pair: &[&Comparison]) -> String {
    let after = |word: &str, holds: fn(&Comparison) -> bool| {
        let found: Vec<_> = pair.iter().filter(|c| holds(c)).map(|c| c.n_touches).collect();
        match found.as_slice() {
            [] => format!("never clearly {word}"),
            [1] => format!("clearly {word} after 1 touch"),
            found => format!("clearly {word} after {} touches", runs(found)),
        }
    };
    format!("{}, {}", after("better", |c| c.ci95[0] > 0.0), after("worse", |c| c.ci95[1] < 0.0))
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
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
    use super::super::super::result::tests::published;
    use super::*;

    fn comparison(against: Choice, n_touches: usize, difference: f64, half: f64) -> Comparison {
        let ci95 = [difference - half, difference + half];
        let (inference, action) = (Inference::Exact, Choice::Information);
        Comparison { inference, action, against, n_touches, difference, ci95 }
    }

    #[test]
    fn what_chance_can_explain_is_not_called_better_or_worse() {
        let of = |n, difference| comparison(Choice::Random, n, difference, 0.0625);
        let all = [of(1, -0.25), of(2, 0.25), of(3, 0.125), of(4, 0.0), of(5, 0.125)];
        let text = verdict(&all.iter().collect::<Vec<_>>());
        assert!(text.starts_with("<b>Most informative action against random action:"), "{text}");
        assert!(text.ends_with("clearly better after 2–3, 5 touches, clearly worse after 1 touch."), "{text}");
        assert!(verdict(&[&all[3]]).ends_with("never clearly better, never clearly worse."));
    }

    #[test]
    fn each_pair_of_rules_has_its_curve_and_its_column() {
        let mut evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        assert!(section(&evaluation).is_none());
        let of = |against| (1..=3).map(move |n| comparison(against, n, -0.125, 0.25));
        evaluation.comparisons = of(Choice::Random).chain(of(Choice::Paper)).collect();
        let html = section(&evaluation).unwrap().html();
        assert_eq!(html.matches("<path class=\"band\"").count(), 2);
        assert_eq!(html.matches("−12.5<small>−37.5 to +12.5</small>").count(), 2 * 3);
    }

    #[test]
    fn the_axis_holds_every_interval_and_nought() {
        let all = [comparison(Choice::Random, 1, 0.25, 0.125), comparison(Choice::Random, 2, 0.5, 0.125)];
        assert_eq!(range(&all.iter().collect::<Vec<_>>()), [-5.0, 62.5]);
    }
}
