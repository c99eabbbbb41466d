use rayon::prelude::*;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_filter::belief::*;
use tactile_filter::episode::*;
use tactile_filter::likelihood::*;
use tactile_infer::bank::Bank;
fn npy(path: &str) -> (Vec<usize>, Vec<f32>) {
    let b = std::fs::read(path).unwrap();
    let n = u16::from_le_bytes([b[8], b[9]]) as usize;
    let head = String::from_utf8_lossy(&b[10..10 + n]).to_string();
    let a = head.find('(').unwrap();
    let z = head.find(')').unwrap();
    let shape = head[a + 1..z].split(',').filter_map(|s| s.trim().parse().ok()).collect();
    (shape, b[10 + n..].chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect())
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (d, qd, half, step, tstep, ne) = (&a[1], &a[2], a[3].parse::<f64>().unwrap(), a[4].parse::<f64>().unwrap(), a[5].parse::<f64>().unwrap(), a[6].parse::<usize>().unwrap());
    let get = |k: &str, v: f64| std::env::var(k).ok().and_then(|s| s.parse::<f64>().ok()).unwrap_or(v);
    let mut c = LikelihoodConfig::default();
    c.temperature = get("TAU", c.temperature);
    c.outlier_floor = get("EPS", c.outlier_floor);
    c.overlap_mm = get("OV", c.overlap_mm);
    if std::env::var("NEAREST").is_ok() { c.look_up = tactile_filter::lookup::LookUp::Nearest; }
    let grid = PoseGrid { xy_half_mm: half, xy_step_mm: step, theta_half_deg: 90.0, theta_step_deg: tstep };
    let (shape, rows) = npy(&format!("{d}/bank.npy"));
    let (_, shares) = npy(&format!("{d}/bank_share.npy"));
    let (_, q) = npy(&format!("{qd}/query.npy"));
    let (_, qs) = npy(&format!("{qd}/query_share.npy"));
    let (_, pose) = npy(&format!("{qd}/pose.npy"));
    let (np, dim) = (shape[0], shape[4]);
    let per = grid.len();
    let make = |skip: Option<usize>| {
        let keep: Vec<usize> = (0..np).filter(|p| Some(*p) != skip).collect();
        let r: Vec<f32> = keep.iter().flat_map(|p| rows[p * per * dim..(p + 1) * per * dim].to_vec()).collect();
        let s: Vec<f32> = keep.iter().flat_map(|p| shares[p * per..(p + 1) * per].to_vec()).collect();
        Bank::from_rows(keep.iter().map(|p| p.to_string()).collect(), grid, dim, r, s, String::new()).unwrap()
    };
    let banks: Vec<Bank> = std::iter::once(None).chain((0..np).map(Some)).map(make).collect();
    let t0 = std::time::Instant::now();
    let ns = [1, 2, 3, 4, 5, 7, 10];
    // per episode: (ok[10], prob[10], xy, th, fit[10] present, fit[10] absent)
    let absent = get("ABSENT", 1.0) > 0.0;
    let res: Vec<_> = (0..ne).into_par_iter().map(|e| {
        let at = |k: usize| { let p = &pose[(e * 10 + k) * 4..]; (p[0] as usize, Se2::new(p[1].into(), p[2].into(), p[3].into())) };
        let (part, first) = at(0);
        let mut out = Vec::new();
        for mode in 0..if absent { 2 } else { 1 } {
            let bank = if mode == 0 { &banks[0] } else { &banks[1 + part] };
            let obs = |k: usize| Observation { query: q[(e * 10 + k) * dim..(e * 10 + k + 1) * dim].to_vec(), edge_share: qs[e * 10 + k] };
            let mut config = EpisodeConfig { likelihood: c, stop_probability: 1.0, ..EpisodeConfig::default() };
            config.max_touches = 20;
            let mut ep = Episode::begin_with(&config, bank, &obs(0)).unwrap();
            let mut rec = Vec::new();
            for k in 0..10 {
                if k > 0 { ep.observe_with(at(k - 1).1.inverse() * at(k).1, &obs(k)).unwrap(); }
                let b = ep.belief();
                let cp = b.class_posterior();
                let (mut bi, mut bp) = (0, 0.0);
                for (i, p) in cp.iter().enumerate() { if *p > bp { bp = *p; bi = i; } }
                let h = b.best(Some(bi)).unwrap();
                let r = b.refine(h);
                let fit = b.fit(bi, &r.part_from_first).unwrap_or(f64::NAN);
                let err = |p: &Se2| (p.distance_mm(&first), wrap_angle(p.theta_rad - first.theta_rad).to_degrees().abs());
                rec.push((bank.parts()[bi] == part.to_string(), bp, err(&grid.pose(h.cell)), err(&r.part_from_first), fit, cp.get(part).copied().unwrap_or(0.0)));
            }
            out.push(rec);
        }
        (part, out)
    }).collect();
    println!("{:.1} s", t0.elapsed().as_secs_f64());
    for n in ns {
        let v: Vec<_> = res.iter().map(|r| &r.1[0][n - 1]).collect();
        let acc = v.iter().filter(|r| r.0).count() as f64 / ne as f64;
        let right: Vec<_> = v.iter().filter(|r| r.0).collect();
        let mean = |f: &dyn Fn(&&&(bool, f64, (f64, f64), (f64, f64), f64, f64)) -> f64| right.iter().map(f).sum::<f64>() / right.len() as f64;
        let med = |f: &dyn Fn(&&&(bool, f64, (f64, f64), (f64, f64), f64, f64)) -> f64| { let mut x: Vec<f64> = right.iter().map(f).collect(); x.sort_by(f64::total_cmp); x[x.len() / 2] };
        let nll = v.iter().map(|r| -r.5.max(1e-9).ln()).sum::<f64>() / ne as f64;
        let conf: Vec<_> = v.iter().filter(|r| r.1 > 0.95).collect();
        let wrong = conf.iter().filter(|r| !r.0).count();
        println!("n {n:2} acc {:.3} nll {nll:.3} conf {} wrong {} | cell xy {:.2} th {:.2} | refined xy {:.2} ({:.2}) th {:.2} ({:.2})", acc, conf.len(), wrong,
            mean(&|r| r.2.0), mean(&|r| r.2.1), mean(&|r| r.3.0), med(&|r| r.3.0), mean(&|r| r.3.1), med(&|r| r.3.1));
        if absent {
            let mut p: Vec<f64> = v.iter().map(|r| r.4).filter(|f| f.is_finite()).collect();
            p.sort_by(f64::total_cmp);
            let ab: Vec<f64> = res.iter().map(|r| r.1[1][n - 1].4).filter(|f| f.is_finite()).collect();
            let pc = |x: f64| p[(x * p.len() as f64) as usize];
            let det = |t: f64| ab.iter().filter(|f| **f < t).count() as f64 / ab.len() as f64;
            println!("      fit present 1 {:.2} 5 {:.2} 50 {:.2}; absent below 1% {:.3} 5% {:.3} 50% {:.3}", pc(0.01), pc(0.05), pc(0.5), det(pc(0.01)), det(pc(0.05)), det(pc(0.5)));
        }
    }
    // stopping
    let (mut stops, mut wrong, mut sum) = (0, 0, 0);
    for r in &res { if let Some(k) = (0..10).find(|k| r.1[0][*k].1 > 0.95) { stops += 1; sum += k + 1; if !r.1[0][k].0 { wrong += 1 } } }
    println!("stops {stops} mean {:.2} wrong {:.3}", sum as f64 / stops as f64, wrong as f64 / stops as f64);
    for (aa, c, b, nmin) in [(-1.2, 0.0, -1.2, 5), (-1.2, 1.0, -1.2, 5), (-1.2, 2.0, -1.2, 5), (-1.2, 3.0, -1.2, 5), (-1.2, 4.0, -1.2, 5), (-1.1, 3.0, -1.1, 5), (-1.1, 3.0, -1.1, 6), (-1.1, 3.0, -1.3, 4), (-1.0, 3.0, -1.4, 4), (-1.0, 2.0, -1.4, 4)] {
        let stop = |rec: &Vec<(bool, f64, (f64, f64), (f64, f64), f64, f64)>| -> (usize, bool, bool) {
            for n in 1..=10 { let r = &rec[n - 1];
                if n >= nmin && r.4 < b { return (n, true, r.0); }
                if r.1 > 0.95 && r.4 >= aa + c / n as f64 { return (n, false, r.0); }
            }
            (10, rec[9].4 < aa, rec[9].0)
        };
        let pr: Vec<_> = res.iter().map(|r| stop(&r.1[0])).collect();
        let mean = pr.iter().map(|s| s.0).sum::<usize>() as f64 / ne as f64;
        let fa = pr.iter().filter(|s| s.1).count() as f64 / ne as f64;
        let wrong = pr.iter().filter(|s| !s.1 && !s.2).count() as f64 / ne as f64;
        if absent { let ab: Vec<_> = res.iter().map(|r| stop(&r.1[1])).collect();
        let det = ab.iter().filter(|s| s.1).count() as f64 / ne as f64;
        let am = ab.iter().map(|s| s.0).sum::<usize>() as f64 / ne as f64;
        println!("A {aa}+{c}/n B {b} nmin {nmin}: touches {mean:.2} false alarm {fa:.3} wrong {wrong:.3} detected {det:.3} after {am:.2}"); }
    }
    for p in 0..np { let v: Vec<_> = res.iter().filter(|r| r.0 == p && r.1[0][9].0).map(|r| r.1[0][9].3).collect(); if !v.is_empty() && a.len() > 7 { println!("{p} {} xy {:.2} th {:.2}", v.len(), v.iter().map(|x| x.0).sum::<f64>() / v.len() as f64, v.iter().map(|x| x.1).sum::<f64>() / v.len() as f64); } }
}
