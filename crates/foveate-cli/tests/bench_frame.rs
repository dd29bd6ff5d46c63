//! `foveate bench frame` through the program.

use std::process::Command;

#[test]
fn it_prints_one_line_of_json() {
    for precision in ["f32", "bf16"] {
        let output = Command::new(env!("CARGO_BIN_EXE_foveate"))
            .args(["bench", "frame", "--particles", "20", "--frames", "2", "--json", "--precision", precision])
            .output()
            .expect("the program starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let line: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one line of JSON");
        assert_eq!((line["n"].as_u64(), line["precision"].as_str()), (Some(20), Some(precision)));
        assert!(line["ms"].as_f64().expect("milliseconds") > 0.0 && line["what"] == "tracker frame", "{line}");
    }
}
