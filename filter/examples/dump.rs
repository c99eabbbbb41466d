use rand::RngExt;
use rayon::prelude::*;
use std::io::Write;
use tactile_data::frame::TactileImage;
use tactile_data::grid::PoseGrid;
use tactile_data::scene::Scene;
use tactile_data::se2::Se2;
use tactile_data::simulator::{Simulator, frame_rng};
use tactile_data::touch::Side;
use tactile_infer::DeviceKind;

fn npy(path: &str, shape: &[usize], values: &[f32]) {
    let mut f = std::io::BufWriter::new(std::fs::File::create(path).unwrap());
    let dims: Vec<String> = shape.iter().map(|n| n.to_string()).collect();
    let mut head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}", dims.join(", "));
    while (head.len() + 11) % 64 != 0 { head.push(' '); }
    head.push('\n');
    f.write_all(b"\x93NUMPY\x01\x00").unwrap();
    f.write_all(&(head.len() as u16).to_le_bytes()).unwrap();
    f.write_all(head.as_bytes()).unwrap();
    for v in values { f.write_all(&v.to_le_bytes()).unwrap(); }
}

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (scene, step, theta, n_ep, out) = (&a[1], a[2].parse::<f64>().unwrap(), a[3].parse::<f64>().unwrap(), a[4].parse::<usize>().unwrap(), &a[5]);
    let mut scene = Scene::load(scene).unwrap();
    let mut grid: PoseGrid = scene.reach.unwrap();
    grid.xy_step_mm = step;
    grid.theta_step_deg = theta;
    scene.reach = Some(grid);
    let sim = Simulator::new(scene, 1).unwrap();
    
    let model = tactile_infer::Model::load(std::path::Path::new("/work/filt/infer/models/maze-tiny.safetensors"), DeviceKind::Flex).unwrap();
    let bg = model.background(&sim.no_contact(1)).unwrap();
    std::fs::create_dir_all(out).unwrap();
    let n_parts = sim.parts().len();
    let embed = |touches: &[(usize, Side, Se2, u64, u64)], peg: bool| -> (Vec<f32>, Vec<f32>) {
        let (mut rows, mut shares) = (Vec::new(), Vec::new());
        for chunk in touches.chunks(512) {
            let images: Vec<TactileImage> = chunk.par_iter().map(|(p, s, pose, seed, stream)| {
                let f = sim.touch(*p, *s, pose, &mut frame_rng(*seed, *stream)).unwrap();
                bg.tactile_image(&f).unwrap()
            }).collect();
            rows.extend(if peg { model.embed_pegs(&images).unwrap() } else { model.embed_holes(&images).unwrap() });
            shares.extend(images.iter().map(|i| i.edge_share));
        }
        (rows, shares)
    };
    if step > 0.0 {
        let mut t = Vec::new();
        for p in 0..n_parts { for c in 0..grid.len() { t.push((p, Side::Peg, grid.pose(c), 1, 1000 + t.len() as u64)); } }
        let (rows, shares) = embed(&t, true);
        npy(&format!("{out}/bank.npy"), &[n_parts, grid.n_xy(), grid.n_xy(), grid.n_theta(), model.dim()], &rows);
        npy(&format!("{out}/bank_share.npy"), &[n_parts, grid.n_xy(), grid.n_xy(), grid.n_theta()], &shares);
    }
    if n_ep > 0 {
        let n_t = 10;
        let (mut t, mut info) = (Vec::new(), Vec::new());
        for e in 0..n_ep {
            let mut rng = frame_rng(77, e as u64);
            let part = rng.random_range(0..n_parts);
            let mut around = |h: f64| h * (2.0 * rng.random::<f64>() - 1.0);
            for i in 0..n_t {
                let pose = Se2::from_degrees(around(grid.xy_half_mm), around(grid.xy_half_mm), around(grid.theta_half_deg));
                t.push((part, Side::Hole, pose, 99, (e * n_t + i) as u64));
                info.extend([part as f32, pose.x_mm as f32, pose.y_mm as f32, pose.theta_rad as f32]);
            }
        }
        let (rows, shares) = embed(&t, false);
        npy(&format!("{out}/query.npy"), &[n_ep, n_t, model.dim()], &rows);
        npy(&format!("{out}/query_share.npy"), &[n_ep, n_t], &shares);
        npy(&format!("{out}/pose.npy"), &[n_ep, n_t, 4], &info);
    }
}
