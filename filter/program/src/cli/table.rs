//! An evaluation as a table on the terminal.

use tactile_data::program;
use tactile_data::text::printable::printable;
use tactile_eval::result::{Evaluation, Method, PromisedShare, Row};

/// Prints it; `inside_out` is the Pixel baseline with its pictures turned inside out.
#[expect(clippy::too_many_lines, reason = "one table, line by line")]
pub fn print(evaluation: &Evaluation, inside_out: &[Row]) {
    let scene = printable(&evaluation.scene);
    println!("{scene}: {} episodes, {} parts", evaluation.n_episodes, evaluation.n_classes);
    if !evaluation.recorded_parts.is_empty() {
        let (n, parts) = (evaluation.recorded_parts.len(), evaluation.recorded_parts.join(" "));
        println!("  {n} parts of the bank were recorded, and only they are touched: {}", printable(&parts));
    }
    if let Some(n) = evaluation.distinct_first_views.filter(|n| *n < evaluation.n_episodes) {
        println!("  they begin with {n} different views: intervals after one touch are of {n}");
    }
    println!(
        "  {:28} {:>2} {:>8} {:>15} {:>15} {:>8} {:>7} {:>7}",
        "method", "n", "right %", "95 % interval", "over parts", "cell %", "xy mm", "deg"
    );
    let print = |name: &str, row: &Row| {
        println!(
            "  {name:28} {:2} {:8.1} {:7.1}-{:<7.1} {:>15} {:8.1} {:7.2} {:7.2}",
            row.n_touches,
            100.0 * row.accuracy,
            100.0 * row.accuracy_ci95[0],
            100.0 * row.accuracy_ci95[1],
            row.accuracy_ci95_clustered.map_or("-".into(), |[low, high]| format!(
                "{:.1}-{:.1}",
                100.0 * low,
                100.0 * high
            )),
            100.0 * row.exact_cell,
            row.xy_mm_mean,
            row.theta_deg_mean
        );
    };
    for row in evaluation.rows.iter().filter(|row| [1, 2, 3, 5, 10].contains(&row.n_touches)) {
        print(&format!("{:?}, {:?}, {:?}", row.method, row.inference, row.action).to_lowercase(), row);
    }
    for row in inside_out {
        print("pixel, sign-flipped", row);
    }
    for stops in &evaluation.stops {
        println!(
            "  {:28} stops after {:.2} touches; confident {:.1} %, of these wrong {:.1} %; none of these {:.1} %; 95 % sure after {:.2}{}",
            format!("{:?}, {:?}", stops.inference, stops.action).to_lowercase(),
            stops.mean_touches,
            100.0 * stops.confident,
            100.0 * stops.confident_and_wrong,
            100.0 * stops.none_of_these,
            stops.touches_to_95,
            stops.seconds.map_or_else(String::new, |seconds| format!("; {seconds:.1} robot seconds")),
        );
    }
    promise(evaluation);
    for c in evaluation.comparisons.iter().filter(|c| [1, 2, 3, 5, 10].contains(&c.n_touches)) {
        let name = format!("{:?}, {:?} less {:?}", c.inference, c.action, c.against).to_lowercase();
        let [low, high] = c.ci95.map(|bound| 100.0 * bound);
        let paired = c.paired.map_or_else(String::new, |paired| {
            format!(", {} against {}, p = {:.3}", paired.better, paired.worse, paired.p_value)
        });
        let (n, points) = (c.n_touches, 100.0 * c.difference);
        println!("  {name:38} n = {n:2}: {points:+.1} points ({low:+.1} to {high:+.1}){paired}");
    }
    for bin in &evaluation.reliability {
        let [low, high] = bin.right_ci95.map(|bound| 100.0 * bound);
        println!(
            "  {:5.1} % sure: {:5.1} % right ({low:.1}-{high:.1}), {} touches",
            100.0 * bin.mean_probability,
            100.0 * bin.right,
            bin.n
        );
    }
    for of in &evaluation.parts {
        let mistaken = of.mistaken_for.as_ref().map_or_else(String::new, |(part, n)| format!(", {n} taken for {part}"));
        let (n, right, part) = (of.n, of.n_right, &of.part);
        let (xy, theta) = (of.xy_mm_mean, of.theta_deg_mean);
        program::say(format_args!("  {part:28} {right} of {n} right{mistaken}; {xy:.2} mm, {theta:.2} degrees"));
    }
    for of in evaluation.strangers.iter().filter(|of| of.n_named() > 0) {
        let (part, n, named) = (&of.part, of.n, of.named_line());
        program::say(format_args!("  {part:28} is not in the bank; of {n} holes named with confidence: {named}"));
    }
    let ms = &evaluation.latency_ms;
    let stages =
        [("encode", Some(ms.encode)), ("update", Some(ms.update)), ("judge", ms.judge), ("choose", Some(ms.select))];
    let stages = stages.iter().filter_map(|(stage, ms)| Some(format!("{stage} {:.2}/{:.2}", (*ms)?.p50, (*ms)?.p99)));
    println!("  ms p50/p99: {}", stages.collect::<Vec<_>>().join(", "));
    if let Some(checksum) = &evaluation.checksum {
        program::say(format_args!("  checksum {checksum}"));
    }
}

/// What the settings promised next to what came.
fn promise(evaluation: &Evaluation) {
    let (Some(promise), Some(stops)) = (&evaluation.promise, evaluation.stops.first()) else { return };
    let right = evaluation.rows.iter().find(|row| row.method == Method::Filter && row.n_touches == promise.n_touches);
    let decided = stops.confident * (1.0 - stops.confident_and_wrong);
    let shares = [
        ("sure and right", promise.decided_and_right, Some(decided)),
        ("right, sure or not", promise.accuracy, right.map(|row| row.accuracy)),
    ];
    for (what, promised, found) in shares {
        if let (Some(PromisedShare { share, ci95: [low, high], .. }), Some(found)) = (promised, found) {
            let [share, low, high, found] = [share, low, high, found].map(|of| 100.0 * of);
            println!(
                "  within {} touches {what}: {found:.1} %; promised {share:.1} % ({low:.1}-{high:.1})",
                promise.n_touches
            );
        }
    }
    if let (Some(promised), Some(found)) = (promise.robot_s, stops.seconds) {
        println!("  robot seconds, mean: {found:.1}; promised {promised:.1}");
    }
}
