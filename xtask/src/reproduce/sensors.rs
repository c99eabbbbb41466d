//! The table of sensors: letters touched anywhere under each, with the model as it comes, with a bank of that sensor,
//! and with the confidence calibrated on it. And parts of other kinds under the default sensor.

use std::path::Path;

use super::parts::Maker;
use crate::error::Result;
use crate::experiments::Part;
use crate::step::Step;

/// Letters for evaluation.
const LETTERS: &str = "ABCDEFGHIJKL";

/// Letters for every choice.
const TUNING_LETTERS: &str = "MNOPQRSTUVWX";

/// The sensor that every other is compared with.
const OWN: &str = "default";

/// The ball of the real presses, mm, and the scale.
const OF_BALLS: &str = "--ball-mm 4.70 --px-per-mm 19.58";

/// Whether a sensor's light is another than the default's.
fn is_other_light(lines: &str) -> bool {
    ["light =", "calibration =", "exposure ="].iter().any(|word| lines.contains(word))
}

impl Maker<'_> {
    /// The steps of every sensor; of letters for evaluation those of other kinds of parts too.
    pub(super) fn sensors(&mut self) -> Result<()> {
        let job = self.job;
        for sensor in &job.experiments.sensors {
            if job.without.contains(&sensor.name) {
                continue;
            }
            if let Some(folder) = &sensor.real {
                self.light_of_balls(&sensor.name, &job.real.join(folder));
            }
            self.sensor(&sensor.name, &sensor.scene)?;
        }
        if self.job.tuning_letters { Ok(()) } else { self.evaluations(Part::Sensors) }
    }

    /// The light of the presses, turned so that they lie as a Mini's frames do; the circles are found.
    fn light_of_balls(&mut self, name: &str, folder: &Path) {
        let [turned, pictures, light] = ["turned", "pictures", "light.toml"].map(|end| format!("{name}-{end}"));
        let program = self.program("tactile-data", "import").arg(folder.join("images")).words("--no-contact");
        let program = program.arg(folder.join("gelsight_bg.png"));
        let program = program.words(format!("--turn 90 --field-of-view-mm 16.34 12.26 --out {turned}"));
        self.add(Step::new(&turned, program, &turned).with_last("meta.json"));
        let program = self.program("tactile-data", format!("export {turned} --to folder --out {pictures}"));
        let index = Path::new(&turned).join("meta.json");
        self.add(Step::new(&pictures, program, &pictures).with_last("index.csv").needs(index));
        let program = self.program("tactile-data", format!("calibrate {pictures} {OF_BALLS} --out {light}"));
        let program = program.words(format!("--no-contact {pictures}/no_contact.png"));
        self.add(Step::new(&light, program, &light).needs(Path::new(&pictures).join("index.csv")));
    }

    /// The steps of one sensor: its scenes, its bank, its calibration, three evaluations.
    fn sensor(&mut self, name: &str, lines: &str) -> Result<()> {
        let name = format!("sensor-{name}");
        let tuning = self.letters(&name, "-tuning", TUNING_LETTERS, lines);
        let tuned = self.calibrate_anywhere(&name, self.job.model, &tuning)?;
        // On letters for tuning the bank of the calibration is the one that is evaluated.
        let (scene, bank) = if self.job.tuning_letters {
            (tuning, format!("{name}-dev.bank"))
        } else {
            let (scene, bank) = (self.letters(&name, "", LETTERS, lines), format!("{name}.bank"));
            let program = self.program("tactile-infer", "bank --model").arg(self.job.model);
            let flags = self.job.experiments.expand("--views pegs $fine $cosine")?;
            let program = program.words(format!("--scene {scene} --out {bank} {flags}"));
            self.add(Step::new(&bank, program, &bank).needs(self.job.model).needs_scene(&scene));
            (scene, bank)
        };
        let of_default = bank.replace(&name, &format!("sensor-{OWN}"));
        let model = self.job.model;
        if is_other_light(lines) {
            let lines = format!("{lines}\nlight_known = false");
            let [end, letters] = if self.job.tuning_letters { ["-tuning", TUNING_LETTERS] } else { ["", LETTERS] };
            let unknown = self.letters(&format!("{name}-unknown"), end, letters, &lines);
            self.touch_anywhere(&format!("{name}-shipped"), model, &of_default, &unknown)?;
            self.touch_anywhere(&format!("{name}-light-known"), model, &of_default, &scene)?;
        } else {
            self.touch_anywhere(&format!("{name}-shipped"), model, &of_default, &scene)?;
        }
        if of_default != bank {
            self.touch_anywhere(&format!("{name}-own-bank"), model, &bank, &scene)?;
        }
        self.touch_anywhere(&format!("{name}-calibrated"), &tuned, &bank, &scene)
    }

    /// Writes the scene of small letters under a sensor; returns its file.
    fn letters(&mut self, name: &str, end: &str, letters: &str, lines: &str) -> String {
        let (file, reach) = (format!("{name}{end}.toml"), "xy_half_mm = 8.0\nxy_step_mm = 4.0");
        let turns = "theta_half_deg = 90.0\ntheta_step_deg = 30.0";
        let text = format!(
            "name = \"{name}{end}\"\n\n[parts.letters]\nletters = \"{letters}\"\nheight_mm = 12.0\n\
             max_width_mm = 16.0\n\n[reach]\n{reach}\n{turns}\n\n[sensor]\n{lines}\n"
        );
        self.add(Step::file(&file, text));
        file
    }

    fn touch_anywhere(&mut self, name: &str, model: &Path, bank: &str, scene: &str) -> Result<()> {
        let (episodes, ways) = (self.job.amount.fewer, self.job.experiments.expand("$default")?);
        let program = self.program("tactile-filter", "evaluate --model").arg(model);
        let program = program.words(format!("--bank {bank} --scene {scene} --other-sensor --poses off-grid"));
        let program = program.words(format!("--episodes {episodes} {ways} --out {name}"));
        let step = Step::new(name, program, name).with_last("evaluation.json");
        self.add(step.needs(model).needs(bank).needs_scene(scene));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::parts::tests::{job, names_of};
    use super::*;

    #[test]
    fn each_sensor_is_evaluated_in_every_way_that_it_differs_in() {
        for tuning_letters in [false, true] {
            let job = job(tuning_letters);
            let names = names_of(&job, &[Part::Sensors]);
            for sensor in job.experiments.sensors.iter().filter(|sensor| sensor.real.is_none()) {
                let sensor = sensor.name.as_str();
                let of = |end: &str| names.iter().any(|name| *name == format!("sensor-{sensor}-{end}"));
                assert!(of("shipped") && of("calibrated") && of("own-bank") == (sensor != OWN), "{sensor}");
                assert_eq!(
                    of("light-known"),
                    ["cmu-lamps", "closed-form-lamps", "half-exposure"].contains(&sensor),
                    "{sensor}"
                );
            }
            let at = |name: &str| names.iter().position(|found| found == name);
            let bank = if tuning_letters { "sensor-default-dev.bank" } else { "sensor-default.bank" };
            assert!(at(bank).unwrap() < at("sensor-soft-gel-shipped").unwrap());
            // Parts that informed no choice stay out of development, and balls that are not there out of both.
            assert_eq!(at("parts-digits").is_some(), !tuning_letters);
            assert!(names.iter().all(|name| !name.contains("fots-balls")));
        }
    }
}
