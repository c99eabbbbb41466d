//! Numbers as a page shows them.

use maud::{Markup, Render, html};

/// A number with so many decimals; a dash where there is none.
pub fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}").replace('-', "−") } else { "–".into() }
}

/// A difference: like [`number`], with its sign.
pub fn signed(value: f64, decimals: usize) -> String {
    let number = number(value, decimals);
    let is_zero = number.trim_start_matches('−').chars().all(|c| matches!(c, '0' | '.'));
    match (is_zero, value > 0.0 && value.is_finite()) {
        (true, _) => number.trim_start_matches('−').into(),
        (false, true) => format!("+{number}"),
        (false, false) => number,
    }
}

/// A share, 0..=1, in per cent without the sign: `90.0`.
pub fn percent(share: f64) -> String {
    number(100.0 * share, 1)
}

/// The same with the sign, which does not leave its number.
pub fn percent_sign(share: f64) -> String {
    format!("{}\u{a0}%", percent(share))
}

/// A duration; the shorter, the more decimals.
pub fn milliseconds(ms: f64) -> String {
    format!("{}\u{a0}ms", number(ms, if ms < 9.95 { 2 } else { 1 }))
}

/// Bounds of an interval of shares, per cent: `87.0–92.0`.
pub fn interval(ci95: [f64; 2]) -> String {
    let [low, high] = ci95.map(percent);
    format!("{low}–{high}")
}

/// Bounds of an interval of differences of shares, points of a per cent: `−1.0 to +3.0`.
pub fn signed_interval(ci95: [f64; 2]) -> String {
    let [low, high] = ci95.map(|bound| signed(100.0 * bound, 1));
    format!("{low} to {high}")
}

/// A cell with something small below its figure.
pub fn over(figure: impl Render, below: impl Render) -> Markup {
    html! { (figure) small { (below) } }
}

/// A cell with a share in per cent over its 95 % interval.
pub fn share(share: f64, ci95: [f64; 2]) -> Markup {
    over(percent(share), interval(ci95))
}

/// A cell with a difference of shares in points over its 95 % interval.
pub fn difference(difference: f64, ci95: [f64; 2]) -> Markup {
    over(signed(100.0 * difference, 1), signed_interval(ci95))
}

/// A cell with a mean over its median, where that is known.
pub fn mean(mean: f64, median: Option<f64>, decimals: usize) -> Markup {
    let mean = number(mean, decimals);
    match median {
        Some(median) => over(mean, format!("median {}", number(median, decimals))),
        None => html! { (mean) },
    }
}

/// The probability of a test: `p = 0.021`.
pub fn p_value(p: f64) -> String {
    if p < 0.001 { "p < 0.001".into() } else { format!("p = {}", number(p, 3)) }
}

/// So many touches.
pub fn touch_count(n: usize) -> String {
    if n == 1 { "1 touch".into() } else { format!("{n} touches") }
}

/// The seeds of a run, in words.
pub fn seeds(seeds: &[u64]) -> String {
    let numbers: Vec<_> = seeds.iter().map(u64::to_string).collect();
    format!("{} {}", if seeds.len() == 1 { "seed" } else { "seeds" }, numbers.join(", "))
}

/// The text with a large first letter.
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_has_a_sign_unless_it_is_zero() {
        let signs = [0.26, -0.26, 0.01, -0.01, f64::NAN].map(|value| signed(value, 1));
        assert_eq!(signs, ["+0.3", "−0.3", "0.0", "0.0", "–"]);
    }

    #[test]
    fn a_cell_has_its_interval_or_its_median_below() {
        assert_eq!(share(0.9, [0.87, 0.92]).0, "90.0<small>87.0–92.0</small>");
        assert_eq!(difference(-0.125, [-0.375, 0.125]).0, "−12.5<small>−37.5 to +12.5</small>");
        assert_eq!(mean(0.2, Some(0.0625), 2).0, "0.20<small>median 0.06</small>");
        assert_eq!(mean(0.2, None, 2).0, "0.20");
    }
}
