//! Presses of a ball: the light fitted to one half of them, the other half named, and the other way round.

use std::fmt::Write;
use std::fs;

use serde_json::Value;

use super::Set;
use super::bench::{Bench, ONE_BALL, Sensor, copy};
use super::light::Light;
use super::named::Named;
use super::twins::{Press, Twins, Views};
use crate::error::{Error, Result};
use crate::json::{entries, number};

/// A set of presses of one ball.
pub struct Balls {
    folder: &'static str,
    title: &'static str,
    source: [&'static str; 2],
    /// Begins the names of all that is made of it.
    name: &'static str,
    part: &'static str,
    ball_mm: f64,
    px_per_mm: f64,
    /// The pictures and the frame at rest, in the folder.
    images: Images,
    rest: &'static str,
    /// Balls among the bank's parts.
    balls: &'static [&'static str],
    /// The sensor, and where its presses were.
    about: &'static str,
}

/// How pictures lie in a folder.
enum Images {
    /// All in one, turned by so many degrees as the model sees wide ones, with a CSV that says where the ball touched.
    Labelled { folder: &'static str, turn: u32, labels: &'static str },
    /// Each in a folder of its own, `FOLDER/N/FILE`; where the ball touched is found.
    Apart { folder: &'static str, file: &'static str },
}

/// Presses on a home-made sensor.
pub const FOTS: Balls = Balls {
    folder: "gelsight-ball-fots",
    title: "Balls (FOTS)",
    source: ["https://github.com/Rancho-zhao/FOTS", "MIT by its README; the repository has no licence file"],
    name: "balls",
    part: "ball:4.7",
    ball_mm: 4.7,
    px_per_mm: 19.58,
    images: Images::Labelled { folder: "images", turn: 90, labels: "labels_derived.csv" },
    rest: "gelsight_bg.png",
    balls: ONE_BALL,
    about: "a ball of 4.70 mm on a home-made sensor with three lamps, their places labelled by hand. The pictures are turned by a quarter, as \
            the model sees wide ones",
};

/// Presses on a Mini.
pub const GELSLAM: Balls = Balls {
    folder: "gsmini-balls-gelslam",
    title: "Balls (GelSLAM)",
    source: ["https://github.com/rpl-cmu/gelslam", "MIT by its README; the repository has no licence file"],
    name: "mini-balls",
    part: "ball:6.31",
    ball_mm: 6.31,
    // 0.0634 mm a pixel.
    px_per_mm: 15.773,
    images: Images::Apart { folder: "6.310mm", file: "gelsight.png" },
    rest: "background.png",
    balls: &["ball:4.7", "ball:6.31", "ball:8", "ball:9.5"],
    about: "a ball of 6.31 mm on a GelSight Mini, many of them cut by the frame's edge; where each was is found by a fit to all of them. Three other \
            balls are in the bank",
};

/// The size of the pictures once they lie as the model's do, pixels.
const FRAME_PX: [f64; 2] = [320.0, 240.0];

/// Presses of an episode, and by how many presses one is ahead of the next: none comes twice among 21 or 22.
const N_TOUCHES: usize = 5;
const STRIDE: usize = 4;

/// What a folder of presses lists of each.
const INDEX: &str = "file,part,side,x_mm,y_mm,theta_deg,episode\n";

/// Presses that calibrate confidence.
const N_CALIBRATING: usize = 10;

/// One press, in the picture as the model sees it.
struct Label {
    /// The picture in the folder of the set.
    file: String,
    centre_px: [f64; 2],
    radius_px: f64,
}

/// The presses that one light was fitted to.
struct Fitted {
    /// The calibration file.
    file: String,
    /// What the fit says of each press.
    presses: Vec<Pressed>,
}

/// Presses of a half, and what was fitted to the other.
struct Half<'a> {
    half: usize,
    presses: &'a [&'a Label],
    fitted: &'a Fitted,
}

/// One press as its fit has it.
struct Pressed {
    /// Where it touched.
    label: Label,
    /// How deep the ball was pressed in, mm.
    depth_mm: f64,
}

impl Balls {
    /// Names every ball by one press and in episodes.
    pub fn name(&self, bench: &Bench<'_>) -> Result<Option<Set>> {
        if !bench.has(self.folder, self.title) {
            return Ok(None);
        }
        let labels = self.labels(bench)?;
        let halves: [Vec<&Label>; 2] = [0, 1].map(|half| labels.iter().skip(half).step_by(2).collect());
        // The light for the presses of a half is fitted to the other.
        let [other, one] = [self.calibrate(bench, 0, &halves[0])?, self.calibrate(bench, 1, &halves[1])?];
        let (mut by_one, mut by_several) = (Vec::new(), Vec::new());
        let (mut by_calibrated, mut as_it_comes) = (Vec::new(), Vec::new());
        let (mut by_touches, mut by_parts) = (Vec::new(), Vec::new());
        let mut twins = Twins::default();
        for (half, light, depths) in [(0, &one, &other), (1, &other, &one)] {
            let presses = &halves[half];
            let n = presses.len();
            let split = |mut named: Vec<Named>, several: &mut Vec<Named>| {
                several.extend(named.split_off(n.min(named.len())));
                named
            };
            let of_half = Half { half, presses, fitted: light };
            let named = self.episodes(bench, &of_half, &Light::Ball)?;
            by_one.extend(split(named, &mut by_several));
            let named = self.calibrated(bench, half, &halves[1 - half], light)?;
            split(named, &mut by_calibrated);
            split(self.episodes(bench, &of_half, &Light::Model)?, &mut as_it_comes);
            let own = self.by_touches(bench, 1 - half)?;
            let of_other = Half { half: 1 - half, presses: &halves[1 - half], fitted: depths };
            let named = self.by_named_parts(bench, &of_other, own.clone())?;
            split(self.episodes(bench, &of_half, &Light::Touches(own))?, &mut by_touches);
            if let Some(named) = named {
                split(self.episodes(bench, &of_half, &Light::Named(named))?, &mut by_parts);
            }
            twins = twins.and(self.compare(bench, half, presses, [light, depths])?);
        }
        let about = format!(
            "{} presses of {}. The light, the gel's length and where exactly the ball touched are fitted to every second press and the \
             others named, and the other way round: no press is named under a light that was fitted to it. The bank is \
             simulated at the depth of the fitted presses. An episode is {N_TOUCHES} presses with the motions between their places: the ball did \
             not move, the sensor did. After one touch the filter is hardly ever confident. Calibrated: confidence, too, by {N_CALIBRATING} presses \
             of the half that the light was fitted to, as a user with 20 presses of a ball would. As it comes: under the light that the model knows. \
             By touches: under the light that the presses of the other half tell without a word of what was pressed or where \
             (`tactile-data calibrate --touches`), the bank as it comes. By touches and their names: under the light and the gel that these presses \
             tell once the filter has named them itself (`tactile-filter replay --label`, `tactile-data calibrate --touches --scene`), the bank, too; \
             what is given of them is the motion from each to the next. A twin is where and as deep as the fit of its own half has the press.",
            labels.len(),
            self.about
        );
        let named = [
            ("one press", by_one),
            ("five presses", by_several),
            ("five presses, calibrated", by_calibrated),
            ("five presses, as it comes", as_it_comes),
            ("five presses, light by touches", by_touches),
            ("five presses, light and gel by touches and their names", by_parts),
        ];
        let named = named.into_iter().filter(|(_, named)| !named.is_empty()).collect();
        Ok(Some(Set { title: self.title, source: self.source, about, named, twins: Some(twins) }))
    }

    /// The pictures as the model sees them, in a folder by the name of the set, and where the ball touched in each.
    fn labels(&self, bench: &Bench<'_>) -> Result<Vec<Label>> {
        let ([x, y], Self { name, folder, rest, .. }) = (self.view_mm(), self);
        let import = |from: &str, more: &str| {
            let line = format!(
                "import {from} {more} --no-contact REAL/{folder}/{rest} --field-of-view-mm {x} {y} --out {name}-raw"
            );
            bench.run("tactile-data", &line)?;
            bench.run("tactile-data", &format!("export {name}-raw --to folder --out {name}"))
        };
        match &self.images {
            Images::Labelled { folder: images, turn, labels } => {
                import(&format!("REAL/{folder}/{images}"), &format!("--turn {turn}"))?;
                let path = bench.real.join(folder).join(labels);
                let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
                // Exported in the order of their names, as the labels are.
                text.lines().skip(1).enumerate().map(|(n, line)| label(n, line)).collect()
            }
            Images::Apart { folder: images, file } => {
                let (from, to) = (bench.real.join(folder).join(images), bench.folder(&format!("{name}-flat"))?);
                for entry in fs::read_dir(&from).map_err(Error::io(&from))? {
                    let entry = entry.map_err(Error::io(&from))?;
                    let number = entry.file_name().to_string_lossy().into_owned();
                    copy(&entry.path().join(file), &to.join(format!("{number:0>3}.png")))?;
                }
                import(&format!("{name}-flat"), "")?;
                let found = self.fitted(bench, name, None)?;
                Ok(found.presses.into_iter().map(|press| press.label).collect())
            }
        }
    }

    fn view_mm(&self) -> [f64; 2] {
        FRAME_PX.map(|px| px / self.px_per_mm)
    }

    /// Fits the light to some presses.
    fn calibrate(&self, bench: &Bench<'_>, half: usize, presses: &[&Label]) -> Result<Fitted> {
        let name = format!("{}-light-{half}", self.name);
        let folder = bench.folder(&name)?;
        let mut labels = "file,center_x,center_y,radius\n".to_owned();
        for Label { file, centre_px: [x, y], radius_px } in presses {
            copy(&bench.out.join(self.name).join(file), &folder.join(file))?;
            line(&mut labels, format_args!("{file},{x},{y},{radius_px}"))?;
        }
        bench.write(&format!("{name}.csv"), &labels)?;
        self.fitted(bench, &name, Some(&format!("{name}.csv")))
    }

    /// The light that presses of a half tell themselves.
    fn by_touches(&self, bench: &Bench<'_>, half: usize) -> Result<String> {
        let Self { name, px_per_mm, .. } = self;
        let file = format!("{name}-touches-{half}.toml");
        let line = format!(
            "calibrate {name}-light-{half} --touches --px-per-mm {px_per_mm} --no-contact {name}/no_contact.png --out {file}"
        );
        bench.run("tactile-data", &line)?;
        Ok(file)
    }

    /// The light of a folder of presses, whose places are labelled or found.
    fn fitted(&self, bench: &Bench<'_>, folder: &str, labels: Option<&str>) -> Result<Fitted> {
        let Self { ball_mm, px_per_mm, name, .. } = self;
        let file = format!("{folder}-light.toml");
        let labels = labels.map_or(String::new(), |csv| format!("--labels {csv} "));
        let fitted = bench.json(
            "tactile-data",
            &format!(
                "calibrate {folder} --ball-mm {ball_mm:.2} --px-per-mm {px_per_mm} {labels}--no-contact {name}/no_contact.png \
                 --out {file}"
            ),
        )?;
        let pressed = |press: &Value| {
            let centre_px = [number(press, "/centre_px/0")?, number(press, "/centre_px/1")?];
            let file = press["file"].as_str().unwrap_or_default().to_owned();
            let label = Label { file, centre_px, radius_px: number(press, "/radius_px")? };
            Ok(Pressed { label, depth_mm: number(press, "/depth_mm")? })
        };
        let presses = entries(&fitted, "/presses")?.iter().map(pressed).collect::<Result<_>>()?;
        Ok(Fitted { file, presses })
    }

    /// What the bank under one light calls the presses of a half: each alone first, then episodes.
    fn episodes(&self, bench: &Bench<'_>, of: &Half<'_>, light: &Light) -> Result<Vec<Named>> {
        let [bank, presses] = self.prepared(bench, of, light)?;
        bench.replay(&bank, &presses)
    }

    /// The light and the gel that presses of a half tell, once the filter has named them under the light that they tell by themselves; `None`
    /// where it is not sure enough of any.
    fn by_named_parts(&self, bench: &Bench<'_>, of: &Half<'_>, own: String) -> Result<Option<String>> {
        let [bank, presses] = self.prepared(bench, of, &Light::Labelling(own))?;
        let labelled = format!("{presses}-labelled");
        let line = format!("replay --model MODEL --bank {bank}.bank --data {presses} --side peg --label {labelled}");
        bench.run("tactile-filter", &line)?;
        if !bench.out.join(&labelled).exists() {
            return Ok(None);
        }
        let file = format!("{}-parts-{}.toml", self.name, of.half);
        bench.run("tactile-data", &format!("calibrate {labelled} --touches --scene {bank}.toml --out {file}"))?;
        Ok(Some(file))
    }

    /// The bank under one light and the presses of a half, each alone first, then episodes: their names. Its parts are pressed as deep as
    /// those that the light was fitted to.
    fn prepared(&self, bench: &Bench<'_>, of: &Half<'_>, light: &Light) -> Result<[String; 2]> {
        let Half { half, presses, fitted } = of;
        let mut depths: Vec<f64> = fitted.presses.iter().map(|press| press.depth_mm).collect();
        depths.sort_by(f64::total_cmp);
        let depth_mm = depths.get(depths.len() / 2).copied();
        let (bank, name) = (self.bank(*half, light), format!("{}{}-{half}", self.name, light.kind()));
        let [calibration, pictures] = light.files(&fitted.file);
        if !bench.out.join(format!("{bank}.bank")).exists() {
            let sensor = Sensor { balls: self.balls, view_mm: self.view_mm(), depth_mm, calibration };
            bench.bank(&bank, &sensor)?;
        }
        let folder = bench.folder(&name)?;
        let mut index = INDEX.to_owned();
        let n = presses.len();
        let alone = (0..n).map(|i| (format!("one-{i:02}"), vec![i]));
        let several =
            (0..n).map(|i| (format!("several-{i:02}"), (0..N_TOUCHES).map(|k| (i + STRIDE * k) % n).collect()));
        for (episode, touches) in alone.chain(several) {
            for (k, press) in touches.into_iter().enumerate() {
                let file = format!("{episode}-{k}.png");
                copy(&bench.out.join(self.name).join(&presses[press].file), &folder.join(&file))?;
                let [x, y] = self.ball_from_sensor_mm(presses[press].centre_px);
                line(&mut index, format_args!("{file},{},peg,{x:.4},{y:.4},0,{episode}", self.part))?;
            }
        }
        bench.write(&format!("{name}/index.csv"), &index)?;
        self.import(bench, &name, pictures)?;
        Ok([bank, format!("{name}-set")])
    }

    fn bank(&self, half: usize, light: &Light) -> String {
        let kind = match light {
            Light::Ball | Light::Named(_) => light.kind(),
            _ => Light::Model.kind(),
        };
        format!("{}-bank{kind}-{half}", self.name)
    }

    /// What the presses of a half are called once the confidence was calibrated by some of the others.
    fn calibrated(&self, bench: &Bench<'_>, half: usize, others: &[&Label], light: &Fitted) -> Result<Vec<Named>> {
        let name = format!("{}-own-{half}", self.name);
        let folder = bench.folder(&name)?;
        let mut index = INDEX.to_owned();
        for Label { file, centre_px, .. } in others {
            copy(&bench.out.join(self.name).join(file), &folder.join(file))?;
            let [x, y] = self.ball_from_sensor_mm(*centre_px);
            line(&mut index, format_args!("{file},{},peg,{x:.4},{y:.4},0,{file}", self.part))?;
        }
        bench.write(&format!("{name}/index.csv"), &index)?;
        self.import(bench, &name, Some(&light.file))?;
        let (bank, own) = (self.bank(half, &Light::Ball), format!("{name}.safetensors"));
        bench.run(
            "tactile-infer",
            &format!(
                "calibrate --model MODEL --bank {bank}.bank --holes {name}-set --side peg --touches {N_CALIBRATING} \
                 --out {own}{}",
                bench.with_maps()
            ),
        )?;
        bench.replay_by(&own, &bank, &format!("{}-{half}-set", self.name))
    }

    /// Imports a folder of presses under a light, the one that the model knows without, as `FOLDER-set`.
    fn import(&self, bench: &Bench<'_>, folder: &str, light: Option<&str>) -> Result<()> {
        let [x, y] = self.view_mm();
        let light = light.map_or(String::new(), |file| format!("--calibration {file} "));
        bench.run(
            "tactile-data",
            &format!(
                "import {folder} --no-contact {}/no_contact.png --field-of-view-mm {x} {y} {light}--out {folder}-set",
                self.name
            ),
        )
    }

    /// The sensor's middle, seen from the ball's, mm.
    fn ball_from_sensor_mm(&self, centre_px: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (0.5 * (FRAME_PX[axis] - 1.0) - centre_px[axis]) / self.px_per_mm)
    }

    /// The presses of a half next to their twins, under the light of the other; places and depths are those that their own
    /// half's fit gives.
    fn compare(&self, bench: &Bench<'_>, half: usize, presses: &[&Label], [light, own]: [&Fitted; 2]) -> Result<Twins> {
        let Self { name, part, .. } = self;
        let press = |label: &&Label| {
            let pressed = own.presses.iter().find(|press| press.label.file == label.file);
            let Pressed { depth_mm, label: Label { file, centre_px, .. } } =
                pressed.ok_or_else(|| Error::invalid(&label.file, "a press of its half", "none"))?;
            let [x, y] = self.ball_from_sensor_mm(*centre_px);
            Ok(Press {
                picture: format!("{name}/{file}"),
                render: format!("{part} --pose={x:.4},{y:.4},0 --depth-mm {depth_mm:.4} --calibration {}", light.file),
            })
        };
        let presses = presses.iter().map(press).collect::<Result<Vec<_>>>()?;
        let (name, rest) = (format!("{name}-twin-{half}"), format!("{name}/no_contact.png"));
        let views = Views { name: &name, rest: &rest, view_mm: self.view_mm(), calibration: Some(&light.file) };
        Twins::of(bench, &views, &presses)
    }
}

/// A line of the labels: file, centre x, centre y and radius in pixels.
fn label(n: usize, line: &str) -> Result<Label> {
    let numbers: Vec<f64> = line.split(',').skip(1).filter_map(|cell| cell.trim().parse().ok()).collect();
    let [x, y, radius_px] = numbers[..] else {
        return Err(Error::invalid(format!("label {}", n + 1), "file, x, y, radius", line));
    };
    let centre_px = [y, FRAME_PX[1] - 1.0 - x];
    Ok(Label { file: format!("{n:06}.png"), centre_px, radius_px })
}

/// Adds a line.
fn line(text: &mut String, line: std::fmt::Arguments<'_>) -> Result<()> {
    writeln!(text, "{line}").map_err(|error| Error::invalid("index", "text", error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_turns_with_its_picture() {
        // 240 x 320: ten pixels from the top right corner lie, turned counter-clockwise, ten from the top left.
        let label = label(4, "0005.png,229,10,40").unwrap();
        assert_eq!((label.file.as_str(), label.centre_px, label.radius_px), ("000004.png", [10.0, 10.0], 40.0));
        // Left of and above the middle is the ball, so that the sensor is to the right of and below it.
        let [x, y] = FOTS.ball_from_sensor_mm(label.centre_px);
        assert!((x - 149.5 / 19.58).abs() < 1e-9 && (y - 109.5 / 19.58).abs() < 1e-9);
        assert!(super::label(0, "0001.png,a,2,3").is_err());
    }

    #[test]
    fn an_episode_holds_no_press_twice() {
        for (n, i) in [21, 22].into_iter().flat_map(|n| (0..n).map(move |i| (n, i))) {
            let mut presses: Vec<usize> = (0..N_TOUCHES).map(|k| (i + STRIDE * k) % n).collect();
            presses.sort_unstable();
            presses.dedup();
            assert_eq!(presses.len(), N_TOUCHES);
        }
    }
}
