//! One view as a picture.

use ratatui::Frame;
use ratatui::layout::{Alignment, Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};
use tactile_data::pose::se2::Se2;
use tactile_data::text::printable::printable;

use super::heat::{self, Mark, arrow};
use super::view::{Camera, Level, Message, Part, Pressed, View};

/// A terminal of this width has the touches in a column of their own.
const WIDE: u16 = 110;

/// A camera's newest frame is old after this, s.
const OLD_S: f64 = 0.5;

/// Draws a view. `chosen`: the part whose map is shown; `None`, or one that is not there: the likeliest.
pub fn draw(view: &View, chosen: Option<&str>, frame: &mut Frame) {
    let area = frame.area();
    let n_messages = (view.messages.len() as u16).clamp(1, (area.height / 8).max(1));
    let rows = [Constraint::Length(1), Constraint::Length(1), Constraint::Min(0), Constraint::Length(n_messages + 2)];
    let [head, verdict, body, messages, keys] =
        Layout::vertical([rows.as_slice(), &[Constraint::Length(1)]].concat()).areas(area);
    let shown = chosen.and_then(|name| view.parts.iter().position(|part| part.name == name)).unwrap_or(0);
    draw_head(view, head, frame);
    frame.render_widget(verdict_line(view), verdict);
    let [parts, map, touches] = columns(body, area.width >= WIDE);
    draw_parts(view, shown, parts, frame);
    draw_map(view, shown, map, frame);
    draw_touches(view, touches, frame);
    draw_messages(&view.messages, messages, frame);
    let help = " q leaves   ↑ ↓ choose a part   Home follows the likeliest";
    frame.render_widget(Line::from(help).dim(), keys);
}

/// Where parts, map and touches are.
fn columns(body: Rect, is_wide: bool) -> [Rect; 3] {
    if is_wide {
        let widths = [Constraint::Length(36), Constraint::Min(0), Constraint::Length(48)];
        return Layout::horizontal(widths).areas(body);
    }
    let [left, map] = Layout::horizontal([Constraint::Length(36), Constraint::Min(0)]).areas(body);
    let [parts, touches] = Layout::vertical([Constraint::Fill(1), Constraint::Fill(1)]).areas(left);
    [parts, map, touches]
}

fn block(title: impl Into<Line<'static>>) -> Block<'static> {
    Block::bordered()
        .border_style(Style::new().fg(Color::DarkGray))
        .title_style(Style::new().fg(Color::Gray))
        .title(title)
}

/// Time and status to the left, the camera to the right.
fn draw_head(view: &View, area: Rect, frame: &mut Frame) {
    let bar = Style::new().fg(Color::White).bg(Color::Indexed(24));
    let camera = camera(&view.camera);
    let is_bad = !view.camera.is_good || view.camera.age_s.is_none_or(|age| age.is_nan() || age > OLD_S);
    let camera_style = if is_bad { Style::new().fg(Color::White).bg(Color::Red).bold() } else { bar };
    let width = (camera.chars().count() as u16).min(area.width);
    let [left, right] = Layout::horizontal([Constraint::Min(0), Constraint::Length(width)]).areas(area);
    let text = vec![
        Span::from(" tactile-filter ").bold(),
        Span::from(format!(" {:.1} s  {} ", view.time_s, printable(&view.status))),
    ];
    frame.render_widget(Paragraph::new(Line::from(text)).style(bar), left);
    frame.render_widget(Paragraph::new(camera).style(camera_style).alignment(Alignment::Right), right);
}

fn camera(camera: &Camera) -> String {
    match (camera.frames_per_s, camera.age_s) {
        (Some(rate), Some(age)) => format!(" camera {rate:.1}/s, {} old ", duration(age)),
        (None, Some(age)) => format!(" camera: no frame for {} ", duration(age)),
        _ => " camera: no frame yet ".into(),
    }
}

fn duration(seconds: f64) -> String {
    if seconds < 1.0 { format!("{:.0} ms", 1e3 * seconds) } else { format!("{seconds:.1} s") }
}

/// The likeliest part with its place, and why the episode is over.
fn verdict_line(view: &View) -> Line<'static> {
    let Some(place) = &view.place else { return Line::from(" no touch yet").dim() };
    let Se2 { x_mm, y_mm, .. } = place.part_from_sensor;
    let ([sd_x, sd_y], turn) = (place.sd_mm, place.part_from_sensor.theta_deg());
    let is_over = view.stop.is_some();
    let mut spans = vec![Span::from(" ")];
    if let Some(reason) = &view.stop {
        spans.push(Span::from(format!(" {} ", printable(reason))).fg(Color::Black).bg(Color::Green).bold());
        spans.push(Span::from(" "));
    }
    let colour = if is_over { Color::Green } else { Color::Yellow };
    let other = place.other.as_ref().map_or_else(String::new, |other| format!(" or {}", printable(other)));
    spans.push(
        Span::from(format!("{} {}{other}", printable(&place.part), percent(place.probability))).fg(colour).bold(),
    );
    spans.push(Span::from(format!(
        "  x {x_mm:.2} ±{sd_x:.2}  y {y_mm:.2} ±{sd_y:.2} mm  {turn:.1} ±{:.1}°",
        place.sd_deg
    )));
    if let Some(nats) = view.entropy_nats {
        spans.push(Span::from(format!("  {nats:.2} nats")).dim());
    }
    Line::from(spans)
}

fn percent(probability: f64) -> String {
    if probability.is_finite() { format!("{:.1} %", 100.0 * probability) } else { "?".into() }
}

/// A line for each part, the one shown always among them.
fn draw_parts(view: &View, shown: usize, area: Rect, frame: &mut Frame) {
    let n_rows = usize::from(area.height.saturating_sub(2));
    let first = (shown + 1).saturating_sub(n_rows);
    let hidden = view.parts.len().saturating_sub(n_rows);
    let title = if hidden > 0 { format!(" Parts ({} of {}) ", n_rows, view.parts.len()) } else { " Parts ".into() };
    let width = usize::from(area.width.saturating_sub(2));
    let lines = view.parts.iter().enumerate().skip(first).take(n_rows);
    let lines: Vec<Line> = lines.map(|(n, part)| part_line(part, n == shown, width)).collect();
    frame.render_widget(Paragraph::new(lines).block(block(title)), area);
}

/// Name, bar, percentage.
fn part_line(part: &Part, is_shown: bool, width: usize) -> Line<'static> {
    const NAME: usize = 10;
    let room = width.saturating_sub(NAME + 11);
    let share = if part.probability.is_finite() { part.probability.clamp(0.0, 1.0) } else { 0.0 };
    let name: String = printable(&part.name).chars().take(NAME).collect();
    let style = if is_shown { Style::new().add_modifier(Modifier::BOLD) } else { Style::new() };
    let colour = if is_shown { Color::Yellow } else { Color::Cyan };
    Line::from(vec![
        Span::styled(format!("{} {name:<NAME$} ", if is_shown { '▸' } else { ' ' }), style),
        Span::from(format!("{:<room$}", bar(share, room))).fg(colour),
        Span::styled(format!("{:>8}", percent(part.probability)), style),
    ])
}

/// A bar of this share of `room` characters, to an eighth of one.
fn bar(share: f64, room: usize) -> String {
    const EIGHTHS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
    let eighths = (share * 8.0 * room as f64).round() as usize;
    format!("{}{}", "█".repeat(eighths / 8), EIGHTHS[eighths % 8])
}

/// The map of the part shown; on the likeliest part with the sensor, the touches and the next one.
fn draw_map(view: &View, shown: usize, area: Rect, frame: &mut Frame) {
    let Some(part) = view.parts.get(shown) else { return frame.render_widget(block(" Where the sensor is "), area) };
    let marks = marks(view, &part.name);
    let reach = part.map.as_ref().map_or_else(String::new, |map| format!(", ±{} mm", map.half_mm));
    let brightest = part.map.as_ref().map_or_else(String::new, |map| format!(" max {} ", percent(map.largest())));
    let mut frame_of_map =
        block(format!(" Sensor on {}, {}{reach} ", printable(&part.name), percent(part.probability)))
            .title_bottom(Line::from(brightest).dim().right_aligned());
    if !marks.is_empty() {
        let legend = [Span::from(" "), "↗".fg(Color::White).bold(), " now  ".into(), "×".fg(Color::Green).bold()];
        let legend = [legend.as_slice(), &[" next  ".into(), "1".fg(Color::Cyan).bold(), " touched ".into()]].concat();
        frame_of_map = frame_of_map.title_bottom(Line::from(legend));
    }
    let inside = frame_of_map.inner(area);
    frame.render_widget(frame_of_map, area);
    match &part.map {
        Some(map) => heat::draw(map, &marks, inside, frame.buffer_mut()),
        None => frame.render_widget(Line::from(" no map of this part").dim(), inside),
    }
}

/// What is marked on the map of a part: known only on the likeliest one.
fn marks(view: &View, part: &str) -> Vec<Mark> {
    let Some(place) = view.place.as_ref().filter(|place| place.part == part) else { return Vec::new() };
    let at = |pose: &Se2| [pose.x_mm, pose.y_mm];
    let taken_in = numbered(&view.touches);
    let mut marks: Vec<Mark> = (view.touched().iter().zip(taken_in))
        .filter_map(|(pose, number)| Some(Mark { at: at(pose), glyph: number?, colour: Color::Cyan }))
        .collect();
    let now = &place.part_from_sensor;
    marks.push(Mark { at: at(now), glyph: arrow(now), colour: Color::White });
    if let Some(motion) = &view.sensor_from_next {
        marks.push(Mark { at: at(&(*now * *motion)), glyph: '×', colour: Color::Green });
    }
    marks
}

/// The number of each touch that was taken in, as one character: 1 to 9, then letters, then `+`.
fn numbered(touches: &[Pressed]) -> Vec<Option<char>> {
    let mut n = 0;
    let mut number = |touch: &Pressed| {
        touch.refused.is_none().then(|| {
            n += 1;
            char::from_digit(n, 36).unwrap_or('+')
        })
    };
    touches.iter().map(&mut number).collect()
}

/// The latest touches: number, place on the likeliest part, share of edge; or why one was refused.
fn draw_touches(view: &View, area: Rect, frame: &mut Frame) {
    let n_rows = usize::from(area.height.saturating_sub(3));
    let skipped = view.touches.len().saturating_sub(n_rows);
    let n_refused = view.touches.iter().filter(|touch| touch.refused.is_some()).count();
    let refused = if n_refused > 0 { format!(", {n_refused} refused") } else { String::new() };
    let title = format!(" Touches: {}{refused} ", view.touches.len() - n_refused);
    let mut poses = view.touched();
    poses.resize(view.touches.len(), Se2::new(f64::NAN, f64::NAN, f64::NAN));
    let rows = view.touches.iter().zip(numbered(&view.touches)).zip(&poses).skip(skipped);
    let head = format!(" {:>2} {:>7} {:>7} {:>7}  {:>5}", "", "x mm", "y mm", "angle", "edge");
    let mut lines = vec![Line::from(head).dim()];
    lines.extend(rows.map(|((touch, number), pose)| touch_line(touch, number, pose)));
    frame.render_widget(Paragraph::new(lines).block(block(title)), area);
}

fn touch_line(touch: &Pressed, number: Option<char>, pose: &Se2) -> Line<'static> {
    if let Some(reason) = &touch.refused {
        return Line::from(format!("  - refused: {}", printable(reason))).fg(Color::Red);
    }
    let edge = touch.edge_share.map_or_else(|| "-".into(), |share| format!("{:.0} %", 100.0 * share));
    let place = format!(" {:>7.2} {:>7.2} {:>6.1}°  {edge:>5}", pose.x_mm, pose.y_mm, pose.theta_deg());
    Line::from(vec![Span::from(format!(" {:>2}", number.unwrap_or('-'))).fg(Color::Cyan).bold(), Span::from(place)])
}

/// The latest messages, the newest first.
fn draw_messages(messages: &[Message], area: Rect, frame: &mut Frame) {
    let line = |message: &Message| {
        let (label, style) = match message.level {
            Level::Info => ("info   ", Style::new().fg(Color::Indexed(75))),
            Level::Warning => ("warning", Style::new().fg(Color::Yellow).bold()),
            Level::Error => ("error  ", Style::new().fg(Color::Red).bold()),
        };
        let time = Span::from(format!(" {:>7.1} s ", message.time_s)).dim();
        Line::from(vec![time, Span::styled(label, style), Span::from(format!(" {}", printable(&message.text)))])
    };
    let n_bad = messages.iter().filter(|message| message.level > Level::Info).count();
    let title = if n_bad > 0 { format!(" Messages: {n_bad} to look at ") } else { " Messages ".into() };
    let mut lines: Vec<Line> = messages.iter().rev().map(line).collect();
    if lines.is_empty() {
        lines.push(Line::from(" nothing to report").dim());
    }
    frame.render_widget(Paragraph::new(lines).block(block(title)), area);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::watch::view::{Place, PlaceMap};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use ratatui::buffer::Buffer;

    /// A map whose only value is at an x and a y of 9 x 9 cells over 16 x 16 mm.
    fn map(x: usize, y: usize, value: f64) -> Option<PlaceMap> {
        let mut values = vec![0.0; 81];
        values[x * 9 + y] = value;
        Some(PlaceMap { n_xy: 9, half_mm: 8.0, values })
    }

    fn view() -> View {
        let part = |name: &str, probability, map| Part { name: name.into(), probability, map };
        let pressed = |x, edge_share, refused: Option<&str>| Pressed {
            moved: Se2::from_degrees(x, 0.0, 0.0),
            edge_share,
            refused: refused.map(Into::into),
        };
        let message = |time_s, level, text: &str| Message { time_s, level, text: text.into() };
        View {
            time_s: 12.34,
            status: "touch me".into(),
            parts: vec![
                part("bayonet", 0.75, map(6, 2, 0.7)),
                part("key", 0.2, map(0, 8, 0.1)),
                part("gable", 0.05, None),
            ],
            place: Some(Place {
                part: "bayonet".into(),
                probability: 0.75,
                other: None,
                part_from_sensor: Se2::from_degrees(4.0, -4.0, 90.0),
                sd_mm: [0.25, 0.5],
                sd_deg: 1.5,
            }),
            sensor_from_next: Some(Se2::new(8.0, 0.0, 0.0)),
            touches: vec![
                pressed(0.0, Some(0.12), None),
                pressed(0.0, None, Some("the frame is dark")),
                pressed(-4.0, Some(0.3), None),
            ],
            entropy_nats: Some(1.25),
            camera: Camera { frames_per_s: Some(24.9), age_s: Some(0.04), is_good: true },
            messages: vec![message(1.0, Level::Info, "started"), message(9.5, Level::Error, "the lamps are off")],
            stop: None,
        }
    }

    fn drawn(view: &View, chosen: Option<&str>, width: u16, height: u16) -> Buffer {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(view, chosen, frame)).unwrap();
        terminal.backend().buffer().clone()
    }

    fn lines(buffer: &Buffer) -> Vec<String> {
        let width = usize::from(buffer.area.width);
        buffer.content.chunks(width).map(|row| row.iter().map(|cell| cell.symbol()).collect()).collect()
    }

    /// The line with all these words in this order.
    fn has(buffer: &Buffer, words: &[&str]) -> bool {
        let follows = |line: &String| {
            words.iter().try_fold(line.as_str(), |rest, word| rest.split_once(word).map(|(_, rest)| rest)).is_some()
        };
        lines(buffer).iter().any(follows)
    }

    #[test]
    fn everything_that_a_user_asks_for_is_there_in_both_sizes() {
        for (width, height) in [(80, 24), (200, 50)] {
            let buffer = drawn(&view(), None, width, height);
            for words in [
                ["12.3 s", "touch me", "24.9/s, 40 ms"].as_slice(),
                &["bayonet 75.0 %", "x 4.00 ±0.25", "y -4.00 ±0.50 mm", "90.0 ±1.5°", "1.25 nats"],
                &["▸ bayonet", "█", "75.0 %"],
                &["key", "20.0 %"],
                &["gable", "5.0 %"],
                &["Sensor on bayonet, 75.0 %, ±8 mm"],
                &["↗ now", "× next", "1 touched", "max 70.0 %"],
                &["Touches: 2, 1 refused"],
                &["refused: the frame is dark"],
                // Quarter turns: 4 mm back along the sensor's x was 4 mm along the part's -y.
                &["1", "4.00", "0.00", "90.0°", "12 %"],
                &["2", "4.00", "-4.00", "90.0°", "30 %"],
                &["9.5 s", "error", "the lamps are off"],
                &["q leaves"],
            ] {
                assert!(has(&buffer, words), "{words:?} in\n{}", lines(&buffer).join("\n"));
            }
        }
    }

    #[test]
    fn a_bar_is_as_long_as_its_part_is_probable() {
        let buffer = drawn(&view(), None, 80, 24);
        let length = |name: &str| {
            let line = lines(&buffer).into_iter().find(|line| line.contains(name) && line.contains('%')).unwrap();
            line.chars().filter(|c| *c == '█').count()
        };
        let of = |name: &str| length(&format!("{name} "));
        // 13 characters of room: 0.75 x 13 = 9.75, 0.2 x 13 = 2.6, 0.05 x 13 = 0.65.
        assert_eq!([of("▸ bayonet"), of("  key"), of("  gable")], [9, 2, 0]);
        assert_eq!(
            [bar(0.0, 10), bar(0.5, 10), bar(0.05, 10), bar(1.0, 3)],
            ["", "█████", "▌", "███"].map(String::from)
        );
    }

    /// Where a character is, among the half blocks of the map.
    fn on_map(buffer: &Buffer, glyph: &str) -> Vec<(usize, usize)> {
        let width = usize::from(buffer.area.width);
        let cells =
            buffer.content.iter().enumerate().filter(|(_, cell)| cell.symbol() == glyph && cell.bg == Color::Black);
        cells.map(|(at, _)| (at % width, at / width)).collect()
    }

    #[test]
    fn the_marks_are_where_the_touches_are() {
        let buffer = drawn(&view(), None, 80, 24);
        let blocks: Vec<_> = lines(&buffer)
            .iter()
            .enumerate()
            .filter(|(_, line)| line.contains('▀'))
            .map(|(y, line)| (line.chars().position(|c| c == '▀').unwrap(), y))
            .collect();
        let ((left, top), n_rows) = (blocks[0], blocks.len());
        // 18 mm from edge to edge; two characters a row.
        let place = |x_mm: f64, y_mm: f64| {
            let share = |mm: f64| (mm + 9.0) / 18.0;
            (left + (share(x_mm) * 2.0 * n_rows as f64) as usize, top + (share(y_mm) * n_rows as f64) as usize)
        };
        assert_eq!(on_map(&buffer, "↓"), [place(4.0, -4.0)], "the sensor");
        assert_eq!(on_map(&buffer, "1"), [place(4.0, 0.0)], "the first touch");
        assert_eq!(on_map(&buffer, "×"), [place(4.0, 4.0)], "the next touch");
    }

    #[test]
    fn another_part_has_its_own_map_without_marks() {
        let buffer = drawn(&view(), Some("key"), 80, 24);
        assert!(has(&buffer, &["▸ key"]) && has(&buffer, &["Sensor on key, 20.0 %"]));
        assert!(has(&buffer, &["max 10.0 %"]) && on_map(&buffer, "×").is_empty());
        assert!(has(&drawn(&view(), Some("gable"), 80, 24), &["no map of this part"]));
        assert_eq!(drawn(&view(), Some("nothing"), 80, 24), drawn(&view(), None, 80, 24));
    }

    #[test]
    fn a_camera_that_is_old_or_bad_is_red() {
        let red = |camera: Camera| {
            let buffer = drawn(&View { camera, ..view() }, None, 80, 24);
            buffer[(79, 0)].bg == Color::Red
        };
        let good = view().camera;
        assert!(!red(good) && red(Camera { age_s: Some(0.6), ..good }) && red(Camera { is_good: false, ..good }));
        assert!(red(Camera { age_s: None, ..good }) && red(Camera::default()));
        let none = View { camera: Camera { frames_per_s: None, age_s: Some(3.2), is_good: false }, ..view() };
        assert!(has(&drawn(&none, None, 80, 24), &["no frame for 3.2 s"]));
    }

    #[test]
    fn the_end_is_said_with_its_reason() {
        let over = View { stop: Some("none of these".into()), ..view() };
        assert!(has(&drawn(&over, None, 80, 24), &[" none of these ", "bayonet 75.0 %"]));
        assert!(!has(&drawn(&view(), None, 80, 24), &["none of these"]));
        assert!(has(&drawn(&View::default(), None, 80, 24), &["no touch yet"]));
        let mut either = View { stop: Some("no more touches".into()), ..view() };
        either.place.as_mut().unwrap().other = Some("key".into());
        assert!(has(&drawn(&either, None, 80, 24), &[" no more touches ", "bayonet 75.0 % or key", "x 4.00"]));
    }

    #[test]
    fn the_part_shown_is_among_many_and_the_latest_touches_are_seen() {
        let part = |n: usize| Part { name: format!("part{n}"), probability: 0.01, map: map(4, 4, 0.01) };
        let touch = |n: usize| Pressed { moved: Se2::IDENTITY, edge_share: Some(n as f32 / 100.0), refused: None };
        let many = View { parts: (0..60).map(part).collect(), touches: (0..40).map(touch).collect(), ..view() };
        let buffer = drawn(&many, Some("part47"), 80, 24);
        assert!(has(&buffer, &["▸ part47"]) && has(&buffer, &["of 60"]), "{}", lines(&buffer).join("\n"));
        assert!(has(&buffer, &["39 %"]) && !has(&buffer, &[" 12 %"]));
    }

    #[test]
    fn control_characters_are_written_out() {
        let rude = "\u{1b}]0;\u{9b}1m".to_owned();
        let mut odd = view();
        (odd.status, odd.stop) = (rude.clone(), Some(rude.clone()));
        (odd.parts[0].name, odd.messages[0].text) = (rude.clone(), rude.clone());
        odd.touches[1].refused = Some(rude.clone());
        let place = odd.place.as_mut().unwrap();
        (place.part, place.other) = (rude.clone(), Some(rude));
        let buffer = drawn(&odd, None, 200, 50);
        let n: usize = lines(&buffer).iter().map(|line| line.matches("\\u{1b}]0;").count()).sum();
        assert_eq!(n, 8, "status, stop, place twice, part, map, touch, message:\n{}", lines(&buffer).join("\n"));
        assert!(has(&buffer, &["▸ \\u{1b}]0;"]));
    }

    #[test]
    fn no_size_and_no_number_breaks_it() {
        let nan = f64::NAN;
        let mut odd = view();
        odd.time_s = nan;
        odd.entropy_nats = Some(f64::INFINITY);
        odd.camera = Camera { frames_per_s: Some(nan), age_s: Some(nan), is_good: true };
        odd.parts[0].probability = nan;
        odd.parts[0].map = Some(PlaceMap { n_xy: 3, half_mm: nan, values: vec![nan; 2] });
        odd.parts[1].name = "a name\nin two lines\twith \u{1b}[31m and 漢字 that is far too long".into();
        odd.parts[1].probability = 7.0;
        odd.sensor_from_next = Some(Se2::new(nan, 1e300, nan));
        odd.place.as_mut().unwrap().part_from_sensor = Se2::new(1e300, f64::INFINITY, nan);
        for (width, height) in (0..40).flat_map(|width| (0..30).map(move |height| (width * 5, height))) {
            for view in [&odd, &view(), &View::default()] {
                let buffer = drawn(view, Some("key"), width, height);
                assert!(buffer.content.iter().all(|cell| !cell.symbol().contains(char::is_control)));
            }
        }
        assert_eq!(drawn(&odd, None, 80, 24)[(79, 0)].bg, Color::Red, "an age that is no number is not young");
    }
}
