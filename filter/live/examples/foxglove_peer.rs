//! Our side of the check of the live views (`cargo xtask views`): serves three topics at a free port,
//! prints the port, and shows numbered messages for some seconds.
//!
//! ```text
//! foxglove_peer SECONDS
//! ```

use std::time::{Duration, Instant};

use tactile_data::recording::ros::definitions;
use tactile_live::foxglove::{Result, Views};

fn main() -> Result<()> {
    let seconds = std::env::args().nth(1).and_then(|word| word.parse().ok()).unwrap_or(10.0);
    let views = Views::open("127.0.0.1:0")?;
    let image = views.channel("/gelsight/image", "sensor_msgs/msg/CompressedImage", definitions::COMPRESSED_IMAGE)?;
    let pose = views.channel("/tool_pose", "geometry_msgs/msg/PoseStamped", definitions::POSE_STAMPED)?;
    let once = views.channel("/tactile_filter/label", "std_msgs/msg/String", "string data\n")?;
    views.send(once, 7, &[0, 1, 0, 0, 2, 0, 0, 0, b'A', 0]);
    println!("{}", views.port());
    let start = Instant::now();
    let mut slowest = Duration::ZERO;
    let mut number = 0u32;
    while start.elapsed() < Duration::from_secs_f64(seconds) {
        let before = Instant::now();
        // 20 kB of bytes that follow from the number.
        let body = (0..20_000u32).map(|i| (i.wrapping_mul(31).wrapping_add(number) >> 3) as u8);
        let message: Vec<_> = [0, 1, 0, 0].into_iter().chain(number.to_le_bytes()).chain(body).collect();
        views.send(image, 1_000_000 * u64::from(number), &message);
        views.send(pose, 1_000_000 * u64::from(number), &message[..64]);
        slowest = slowest.max(before.elapsed());
        number += 1;
        std::thread::sleep(Duration::from_millis(40));
    }
    println!("slowest {:.3} ms, viewers at the end {}", slowest.as_secs_f64() * 1e3, views.n_viewers());
    Ok(())
}
