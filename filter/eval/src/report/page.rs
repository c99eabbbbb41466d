//! The page: key figures, curves, what the other modules of the report tell, episodes, how it was made.

use std::io;

use super::super::result::{Evaluation, Method, Poses, Row, Stops};
use super::curves::{Line, Marker, Point, chart, legend_mark};
use super::series::{Series, leading_filter, series, way};
use super::shell::{Section, shell};
use super::table::{SCRIPT, sortable};
use super::{Board, EpisodeStory, PaperNumbers, PaperRow};
use super::{comparison, escape, number, parts, reliability, stopping, viewer};

/// The columns of the first table: the numbers of touches that the paper reports.
const TOUCHES: [usize; 4] = [1, 3, 5, 10];

/// The whole page.
pub fn html(
    evaluation: &Evaluation,
    board: &Board,
    episodes: &[EpisodeStory],
    paper: &PaperNumbers,
) -> io::Result<String> {
    let mut sections = Vec::new();
    // Without their parts in the bank, nothing is right and no pose is true.
    if evaluation.absent {
        sections.push(stopping::section(evaluation));
    } else {
        let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter);
        let lead = lead.map_or(String::new(), |row| way(row.inference, row.action));
        sections.extend([beside_paper(evaluation, paper), curves(evaluation, paper)]);
        sections.extend(comparison::section(evaluation));
        sections.extend(reliability::section(evaluation, &lead));
        sections.push(stopping::section(evaluation));
        sections.extend(parts::section(evaluation, &lead));
    }
    sections.push(stopping::speed(evaluation));
    sections.extend(viewer::section(board, episodes)?);
    sections.push(how_made(evaluation));
    let title = format!("Tactile-Filter: {}", evaluation.scene);
    let scripts = if episodes.is_empty() { vec![SCRIPT] } else { vec![SCRIPT, viewer::SCRIPT] };
    Ok(shell(&title, viewer::CSS, &head(evaluation, paper), &sections, &scripts))
}

fn head(evaluation: &Evaluation, paper: &PaperNumbers) -> String {
    let tiles = if evaluation.absent { absent_tiles(evaluation) } else { tiles(evaluation, paper) };
    let what = if evaluation.absent {
        "Here each hole’s own part was taken out of the bank: no part is right, and the filter should say “none of these parts”."
    } else {
        "Touch by touch the filter works out which part it is, and where on it the sensor stands."
    };
    format!(
        r#"<h1>Which peg fits this hole? {}</h1>
<p>A simulated tactile sensor touches the hole of one of {} parts, whose pegs it has touched before. {what}
{} episodes, {}.</p>
<p class="caution"><b>All of it is simulated:</b> the boards, the robot, each touch. What was held against reality is
the sensor’s optics and gel, by real images of a ball, grooves, a cuboid and a digit (<code>cargo xtask
validate</code>). No real hole, peg or letter was touched: how these figures carry over to a real board is not known.</p>
<div class="tiles">{}</div>
"#,
        escape(&evaluation.scene),
        evaluation.n_classes,
        evaluation.n_episodes,
        seeds(evaluation),
        tiles.concat()
    )
}

/// The key figures: accuracy, wrong answers, pose, time.
fn tiles(evaluation: &Evaluation, paper: &PaperNumbers) -> Vec<String> {
    let kinds = [(Poses::OnGrid, "on grid"), (Poses::OffGrid, "off grid")];
    let found = kinds.iter().find_map(|(poses, name)| Some((leading_filter(evaluation, *poses)?, *name)));
    let mut tiles = Vec::new();
    if let Some((series, poses)) = &found {
        for row in TOUCHES[1..].iter().filter_map(|n| series.at(*n)) {
            let paper = paper.at(row.n_touches);
            let paper = paper.map(|paper| format!("; the paper: {}&nbsp;%", number(paper.accuracy_percent, 1)));
            let what = format!("right part after {}, {poses}{}", touches(row.n_touches), paper.unwrap_or_default());
            tiles.push(tile(&percent(row.accuracy), &what));
        }
    }
    tiles.push(match leading_stops(evaluation) {
        Some(stops) => tile(&percent(stops.confident_and_wrong), "of confident stops name a wrong part"),
        None => tile(&percent(evaluation.stopping.confident_and_wrong), "of episodes stop sure of a wrong part"),
    });
    let last = found.iter().find_map(|(series, _)| series.at(10).or(series.rows.last().copied()));
    tiles.extend(last.map(|row| {
        let (what, [mm, deg]) = match (row.xy_mm_median, row.theta_deg_median) {
            (Some(mm), Some(deg)) => ("median", [mm, deg]),
            _ => ("mean", [row.xy_mm_mean, row.theta_deg_mean]),
        };
        let errors = format!("{} mm · {}°", number(mm, 2), number(deg, 1));
        tile(&errors, &format!("{what} error of the pose after {}, where the part is right", touches(row.n_touches)))
    }));
    tiles.push(decision_time(evaluation));
    tiles
}

/// The key figures where no part is right: how often that is seen.
fn absent_tiles(evaluation: &Evaluation) -> Vec<String> {
    let stops = leading_stops(evaluation).map(|stops| {
        [
            tile(&percent(stops.none_of_these), "of episodes rightly stop with “none of these parts”"),
            tile(&percent(stops.confident), "of episodes stop sure of a part, each of them wrong"),
            tile(&number(stops.mean_touches, 1), "touches until it stops, on average"),
        ]
    });
    stops.into_iter().flatten().chain([decision_time(evaluation)]).collect()
}

/// What the stopping rule did with the way of inferring that the evaluation is about.
fn leading_stops(evaluation: &Evaluation) -> Option<&Stops> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter)?;
    evaluation.stops.iter().find(|stops| (stops.inference, stops.action) == (lead.inference, lead.action))
}

fn decision_time(evaluation: &Evaluation) -> String {
    let latency = &evaluation.latency_ms;
    let decision_ms = latency.encode.p50 + latency.update.p50 + latency.select.p50;
    tile(&milliseconds(decision_ms), "per touch: see, update, choose the next (sum of medians)")
}

fn tile(figure: &str, what: &str) -> String {
    format!(r#"<div class="tile"><b>{figure}</b>{what}</div>"#)
}

/// The filter and the baselines beside the paper at the paper's numbers of touches.
fn beside_paper(evaluation: &Evaluation, paper: &PaperNumbers) -> Section {
    let on_grid = series(evaluation, Poses::OnGrid);
    let ours = [(Poses::OnGrid, "on grid"), (Poses::OffGrid, "off grid")]
        .map(|(poses, suffix)| leading_filter(evaluation, poses).map(|series| (series, suffix)));
    let accuracy_cell = |row: &Row| {
        let [low, high] = row.accuracy_ci95.map(|bound| number(100.0 * bound, 1));
        format!("{}<small>{low}–{high}</small>", number(100.0 * row.accuracy, 1))
    };
    let error_cell = |mean: f64, median: Option<f64>, decimals| {
        let median = median.map(|median| format!("<small>median {}</small>", number(median, decimals)));
        number(mean, decimals) + &median.unwrap_or_default()
    };
    let filters = |cell: &dyn Fn(&Row) -> String| -> String {
        let filter = |(series, suffix): &(Series, &str)| {
            table_row("ours", &format!("This filter, {suffix}"), |n| series.at(n).map(cell))
        };
        ours.iter().flatten().map(filter).collect()
    };
    let papers = |label: &str, value: &dyn Fn(usize) -> Option<f64>| {
        let known = TOUCHES.iter().any(|n| value(*n).is_some());
        let row = || table_row("", label, |n| value(n).map(|value| number(value, 1)));
        if known { row() } else { String::new() }
    };
    let baselines: String = on_grid
        .iter()
        .filter(|series| series.method != Method::Filter)
        .map(|series| table_row("", &series.label(), |n| series.at(n).map(accuracy_cell)))
        .collect();
    let body = [
        group("Right part, % (95 % interval)"),
        filters(&accuracy_cell),
        papers("The paper (one touch: its MoCo)", &|n| paper.at(n).map(|row| row.accuracy_percent)),
        baselines,
        papers("The paper’s Pixel", &|n| paper.pixel.filter(|_| n == 1).map(|row| row.accuracy_percent)),
        group("Mean error of the place, mm"),
        filters(&|row| error_cell(row.xy_mm_mean, row.xy_mm_median, 2)),
        papers("The paper", &|n| paper.at(n)?.xy_mm),
        group("Mean error of the angle, degrees"),
        filters(&|row| error_cell(row.theta_deg_mean, row.theta_deg_median, 1)),
        papers("The paper", &|n| paper.at(n)?.theta_deg),
    ];
    let best: Vec<_> = ours.iter().flatten().map(|(series, suffix)| format!("{suffix}, {}", series.way())).collect();
    let best =
        if best.is_empty() { String::new() } else { format!("This filter is the default: {}. ", best.join("; ")) };
    let heads: String = TOUCHES.iter().map(|n| format!("<th>{n}</th>")).collect();
    let caution = if paper.rows.is_empty() {
        "The paper has no numbers for this scene."
    } else {
        "The paper’s numbers are from a real robot and printed boards, these are simulated: a yardstick, not a race."
    };
    let body = format!(
        r#"<figure><div class="scroll"><table><thead><tr><th>Touches</th>{heads}</tr></thead><tbody>{}</tbody></table></div>
<figcaption>Read along a row how touches add up. {best}{caution}</figcaption></figure>
"#,
        body.concat()
    );
    Section::new("Beside the paper", "Touch by touch, beside the paper", body)
}

fn group(title: &str) -> String {
    format!(r#"<tr class="group"><th colspan="5">{title}</th></tr>"#)
}

fn table_row(class: &str, label: &str, cell: impl Fn(usize) -> Option<String>) -> String {
    let cells: String = TOUCHES.iter().map(|n| format!("<td>{}</td>", cell(*n).unwrap_or_default())).collect();
    format!(r#"<tr class="{class}"><td>{label}</td>{cells}</tr>"#)
}

fn curves(evaluation: &Evaluation, paper: &PaperNumbers) -> Section {
    let kinds = [
        (Poses::OnGrid, "Poses on the recorded grid, as in the paper", paper.rows.as_slice()),
        (Poses::OffGrid, "Poses anywhere in the recorded range, at any angle", &[]),
    ];
    let figures: String = kinds
        .into_iter()
        .map(|(poses, title, paper)| (series(evaluation, poses), title, paper))
        .filter(|(series, ..)| !series.is_empty())
        .map(|(series, title, paper)| figure(&series, title, paper))
        .collect();
    Section::new("Accuracy", "Accuracy and error against touches", figures + &all_rows(evaluation))
}

fn figure(series: &[Series], title: &str, paper: &[PaperRow]) -> String {
    let papers = |value: fn(&PaperRow) -> f64| {
        let point = |row: &PaperRow| Point { n_touches: row.n_touches, value: value(row), interval: None };
        let points = paper.iter().map(point).collect();
        Line { label: "The paper".into(), class: "reference".into(), marker: Marker::Diamond, points }
    };
    let right = |row: &Row| (100.0 * row.accuracy, Some(row.accuracy_ci95.map(|bound| 100.0 * bound)));
    let accuracy = series.iter().map(|series| series.line(right)).chain([papers(|row| row.accuracy_percent)]).collect();
    // Pixel names few parts right, and its errors would press all others flat.
    let errors = |value: fn(&Row) -> f64| -> Vec<Line> {
        let shown = series.iter().filter(|series| series.method != Method::Pixel);
        shown.map(|series| series.line(|row| (value(row), None))).collect()
    };
    let mut charts: Vec<(_, Vec<Line>, _)> = vec![
        ("Right part, %", accuracy, Some([0.0, 100.0])),
        ("Place: mean error, mm", errors(|row| row.xy_mm_mean), None),
        ("Angle: mean error, degrees", errors(|row| row.theta_deg_mean), None),
    ];
    charts[1].1.push(papers(|row| row.xy_mm.unwrap_or(f64::NAN)));
    charts[2].1.push(papers(|row| row.theta_deg.unwrap_or(f64::NAN)));
    if series.iter().flat_map(|series| &series.rows).any(|row| row.xy_mm_median.is_some()) {
        charts.push(("Place: median error, mm", errors(|row| row.xy_mm_median.unwrap_or(f64::NAN)), None));
        charts.push(("Angle: median error, degrees", errors(|row| row.theta_deg_median.unwrap_or(f64::NAN)), None));
    }
    let charts: Vec<String> = charts
        .iter()
        .map(|(name, lines, range)| format!("<div><p>{name}</p>{}</div>", chart(name, lines, *range)))
        .collect();
    let mut legend: Vec<_> = series
        .iter()
        .map(|series| {
            let (class, marker) = series.class_and_marker();
            format!("<li>{}{}</li>", legend_mark(&class, marker, series.rows.len() > 1), series.label())
        })
        .collect();
    if !paper.is_empty() {
        legend.push(format!("<li>{}The paper, real boards</li>", legend_mark("reference", Marker::Diamond, false)));
    }
    format!(
        r#"<figure><h4>{title}</h4><div class="charts">{}<ul class="legend">{}</ul>{}</div>
<figcaption>Right parts: higher is better; bands and bars are 95 % intervals. Errors: lower is better; they are those of the
episodes that name the right part: a mean far above its median is made by few episodes that are far off. Pixel is left out there. Pixel and MoCo: the part of the most similar recorded picture or embedding. The stopping rule is off, so that every episode counts at every number of touches.</figcaption></figure>"#,
        charts[..3].concat(),
        legend.concat(),
        charts[3..].concat(),
    )
}

fn how_made(evaluation: &Evaluation) -> Section {
    let model = &evaluation.model;
    let [width, height] = model.input_px;
    let command = evaluation.command.as_ref();
    let command = command.map(|command| format!("<dt>Command</dt><dd><code>{}</code></dd>", escape(command)));
    let body = format!(
        r#"<dl>{}<dt>Model</dt><dd>{}, {} parameters, input {width} × {height} pixels</dd>
<dt>SHA-256 of the model</dt><dd><code>{}</code></dd><dt>Episodes</dt><dd>{} of {}, {}</dd></dl>
"#,
        command.unwrap_or_default(),
        escape(&model.name),
        model.parameters,
        escape(&model.sha256),
        evaluation.n_episodes,
        escape(&evaluation.scene),
        seeds(evaluation),
    );
    Section::new("How it was made", "How it was made", body)
}

fn all_rows(evaluation: &Evaluation) -> String {
    let cells = |label: &str, poses: &str, row: &Row| {
        let [low, high] = row.accuracy_ci95.map(|bound| number(100.0 * bound, 1));
        let median = |value: Option<f64>, decimals| number(value.unwrap_or(f64::NAN), decimals);
        vec![
            label.into(),
            poses.into(),
            row.n_touches.to_string(),
            number(100.0 * row.accuracy, 1),
            format!("{low}–{high}"),
            number(100.0 * row.exact_cell, 1),
            number(row.xy_mm_mean, 2),
            median(row.xy_mm_median, 2),
            number(row.theta_deg_mean, 1),
            median(row.theta_deg_median, 1),
            number(row.brier, 3),
        ]
    };
    let rows: Vec<_> = [(Poses::OnGrid, "on grid"), (Poses::OffGrid, "off grid")]
        .into_iter()
        .flat_map(|(poses, name)| series(evaluation, poses).into_iter().map(move |series| (series, name)))
        .flat_map(|(series, name)| series.rows.iter().map(|row| cells(&series.label(), name, row)).collect::<Vec<_>>())
        .collect();
    let place_and_angle = ["mm, mean", "median", "degrees, mean", "median"];
    let heads = ["Way", "Poses", "Touches", "Right, %", "95 %", "Right cell, %"].into_iter().chain(place_and_angle);
    let table = sortable(&heads.chain(["Brier"]).collect::<Vec<_>>(), &rows);
    format!("<details><summary>All numbers</summary>{table}</details>\n")
}

fn percent(share: f64) -> String {
    format!("{}&nbsp;%", number(100.0 * share, 1))
}

fn touches(n_touches: usize) -> String {
    if n_touches == 1 { "1 touch".into() } else { format!("{n_touches} touches") }
}

fn milliseconds(value: f64) -> String {
    format!("{}&nbsp;ms", number(value, if value < 10.0 { 1 } else { 0 }))
}

fn seeds(evaluation: &Evaluation) -> String {
    let seeds: Vec<_> = evaluation.seeds.iter().map(u64::to_string).collect();
    format!("{} {}", if seeds.len() == 1 { "seed" } else { "seeds" }, seeds.join(", "))
}
