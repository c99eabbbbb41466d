use tactile_data::scene::Scene;
use tactile_data::simulator::Simulator;
use tactile_filter::episode::*;
use tactile_filter::offline::evaluate::*;
use tactile_filter::offline::result::Poses;
use tactile_infer::{DeviceKind, Model, bank::Bank};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let model = Model::load(std::path::Path::new("/work/filt/infer/models/maze-tiny.safetensors"), DeviceKind::Flex).unwrap();
    let bank = Bank::load(std::path::Path::new(&a[1]), &model).unwrap();
    let sim = Simulator::new(Scene::load(&a[2]).unwrap(), 1).unwrap();
    let nc = sim.no_contact(1 ^ 0x7265_7374);
    let eye = Eye::new(&model, &nc).unwrap();
    let p = Protocol { n_episodes: 150, seeds: vec![1, 2, 3], poses: Poses::OffGrid, absent: false, n_touches: 10 };
    let mut hist = std::collections::BTreeMap::new();
    for i in 0..150 {
        let mut lines = vec![];
        let mut right = true;
        run_one(&sim, &eye, (&bank, &[]), &{ let mut c = EpisodeConfig::default(); c.action.min_separation_mm = 3.0; c.likelihood.overlap_mm = 4.0; if std::env::var("RND").is_ok() { c.action.rule = tactile_filter::action::ActionRule::Random; } c }, &p, i, &mut |h, _f, e, est| {
            let t = e.belief().touches().last().unwrap();
            let pose = h.part_from_sensor();
            let look = t.log_look(bank.grid(), h.part_index(), &h.part_from_first());
            let log = t.log_pose(bank.grid(), h.part_index(), &h.part_from_first());
            let _ = (&mut lines, &mut right, est);
            if let Some(l) = look {
                let m = (8.0f64.min(20.0) - pose.x_mm.abs()).min(8.0 - pose.y_mm.abs());
                let mt = 90.0 - pose.theta_deg().abs();
                let key = (format!("{} {} n{}", if m < 0.0 { "a<0" } else if m < 1.0 { "b<1" } else if m < 2.0 { "c<2" } else { "d" }, if mt < 0.0 { "a<0" } else if mt < 7.5 { "b<7" } else if mt < 15.0 { "c<15" } else { "d" }, if lines.is_empty() { 1 } else { 2 }), false);
                let e = hist.entry(key).or_insert((0, 0.0, 0.0)); e.0 += 1; e.1 += l; e.2 += log;
            }
            lines.push(String::new());
        }).unwrap();
    }
    for (k, v) in &hist { println!("{:?} {} look {:.2} log {:.2}", k, v.0, v.1 / v.0 as f64, v.2 / v.0 as f64); }
}
