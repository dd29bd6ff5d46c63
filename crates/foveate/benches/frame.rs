//! One tracker frame, one thread: see `foveate::bench`. `cargo bench --bench frame -- [frames]`; one JSON line a figure.

use foveate::bench;
use foveate::identity::encoder::Precision;

fn main() {
    let frames = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(201);
    for (name, precision) in [("f32", Precision::F32), ("bf16", Precision::Bf16)] {
        for n in [100, 500, 1000] {
            let time = bench::frame(n, precision, frames).expect("the parts fit");
            println!(
                r#"{{"what": "tracker frame", "precision": "{name}", "n": {n}, "ms": {:.4}, "best_ms": {:.4}}}"#,
                time.median, time.best
            );
        }
    }
}
