//! Output files: VTU frames, atomic folders, determinism, interruption.

use crate::common::{SMALL, arlequin, command, number, scratch, succeed, summary, text};
use std::path::{Path, PathBuf};

fn small(folder: &Path) -> PathBuf {
    let path = folder.join("small.toml");
    std::fs::write(&path, SMALL).expect("scene");
    path
}

fn entries(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("folder")
        .map(|e| e.expect("entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn attribute<'a>(tag: &'a str, name: &str) -> &'a str {
    let start = tag.find(&format!("{name}=\"")).expect("attribute") + name.len() + 2;
    tag[start..].split('"').next().expect("closing quote")
}

/// Name, type, number of components and bytes of an array.
type Array = (String, String, usize, Vec<u8>);

/// Returns the numbers of points and cells of a VTU file, and its arrays.
fn arrays(bytes: &[u8]) -> (usize, usize, Vec<Array>) {
    let mark = b"<AppendedData encoding=\"raw\">\n_";
    let start = bytes
        .windows(mark.len())
        .position(|w| w == mark)
        .expect("data section");
    let head = std::str::from_utf8(&bytes[..start]).expect("text header");
    let data = &bytes[start + mark.len()..];
    let piece = head.lines().find(|l| l.contains("<Piece")).expect("piece");
    let count = |name| attribute(piece, name).parse().expect("count");
    let mut out = Vec::new();
    for tag in head.lines().filter(|l| l.contains("<DataArray")) {
        let offset: usize = attribute(tag, "offset").parse().expect("offset");
        let size = u64::from_le_bytes(data[offset..offset + 8].try_into().expect("size")) as usize;
        let components = attribute(tag, "NumberOfComponents").parse().expect("components");
        let block = data[offset + 8..offset + 8 + size].to_vec();
        out.push((
            attribute(tag, "Name").to_owned(),
            attribute(tag, "type").to_owned(),
            components,
            block,
        ));
    }
    (count("NumberOfPoints"), count("NumberOfCells"), out)
}

/// A reader that leaves early, such as `head -1`, is no failure of the program.
#[cfg(unix)]
#[test]
fn a_pipe_may_be_closed_early() {
    let folder = scratch("pipe");
    let mut child = command(&["check", "--verbose", text(&small(&folder))])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary runs");
    drop(child.stdout.take());
    let out = child.wait_with_output().expect("the binary ends");
    let error = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && !error.contains("panicked"), "{error}");
}

#[test]
fn vtu_files_read_back() {
    let folder = scratch("vtu");
    let out = folder.join("out");
    succeed(&[
        "run",
        text(&small(&folder)),
        "--out",
        text(&out),
        "--set",
        "output.every=20",
    ]);
    let index = std::fs::read_to_string(out.join("results.pvd")).expect("index");
    let listed: Vec<&str> = index
        .lines()
        .filter(|l| l.contains("<DataSet"))
        .map(|l| attribute(l, "file"))
        .collect();
    // Two models and a mediator at steps 0, 20, 40 and 50.
    assert_eq!(listed.len(), 12);
    assert_eq!(entries(&out.join("vtu")).len(), 12);
    for file in listed {
        let bytes = std::fs::read(out.join(file)).expect("listed file");
        let (points, cells, arrays) = arrays(&bytes);
        let names: Vec<&str> = arrays.iter().map(|a| a.0.as_str()).collect();
        if file.contains("mediator") {
            assert!(names.contains(&"multiplier"));
        } else {
            for name in [
                "displacement [m]",
                "velocity [m/s]",
                "alpha",
                "beta",
                "gamma",
                "energy density [J/m3]",
            ] {
                assert!(names.contains(&name), "{name} in {file}");
            }
        }
        for (name, kind, components, block) in &arrays {
            let rows = match name.as_str() {
                "connectivity" => cells * 8,
                "offsets" | "types" | "energy density [J/m3]" => cells,
                _ => points,
            };
            let width = match kind.as_str() {
                "UInt8" => 1,
                "Int32" | "Float32" => 4,
                _ => 8,
            };
            let plain = ["displacement [m]", "velocity [m/s]", "position [m]"].contains(&name.as_str());
            assert!(!plain || kind == "Float64", "{name} in {file} is {kind}");
            assert_eq!(block.len(), rows * components * width, "{name} in {file}");
            let finite = match kind.as_str() {
                "Float64" => block
                    .as_chunks()
                    .0
                    .iter()
                    .all(|b| f64::from_le_bytes(*b).is_finite()),
                "Float32" => block
                    .as_chunks()
                    .0
                    .iter()
                    .all(|b| f32::from_le_bytes(*b).is_finite()),
                _ => true,
            };
            assert!(finite, "{name} in {file}");
        }
    }
}

#[test]
fn folders_appear_at_once_and_are_not_overwritten() {
    let folder = scratch("atomic");
    let scene = small(&folder);
    let out = folder.join("out");
    let arguments = ["run", text(&scene), "--out", text(&out)];
    succeed(&arguments);
    assert_eq!(entries(&folder), ["out", "small.toml"]);
    let second = arlequin(&arguments);
    assert_eq!(second.status.code(), Some(2));
    std::fs::remove_file(out.join("probes.csv")).expect("file");
    succeed(&["run", text(&scene), "--out", text(&out), "--force"]);
    assert!(out.join("probes.csv").exists() && out.join("summary.json").exists());
    assert_eq!(entries(&folder), ["out", "small.toml"]);
}

#[test]
fn a_failed_run_leaves_nothing() {
    let folder = scratch("failed");
    let scene = small(&folder);
    let out = folder.join("out");
    let failed = arlequin(&[
        "run",
        text(&scene),
        "--out",
        text(&out),
        "--set",
        "model.left.material.young=-1",
    ]);
    assert_eq!(failed.status.code(), Some(2));
    assert_eq!(entries(&folder), ["small.toml"]);
}

#[test]
fn same_bits_with_one_and_two_threads() {
    let folder = scratch("threads");
    let scene = small(&folder);
    let outs = ["1", "2"].map(|n| {
        let out = folder.join(n);
        let spacing = "model.right.spacing=0.125";
        succeed(&[
            "run",
            text(&scene),
            "--out",
            text(&out),
            "--threads",
            n,
            "--set",
            spacing,
        ]);
        assert_eq!(number(&summary(&out), "/threads").to_string(), n);
        out
    });
    let assert_same_file = |file: &str| {
        let [a, b] = [0, 1].map(|k: usize| std::fs::read(outs[k].join(file)).expect("file"));
        assert!(a == b, "{file} differs");
    };
    assert_same_file("probes.csv");
    assert_same_file("energy.csv");
    let frames = entries(&outs[0].join("vtu"));
    assert!(frames.len() > 3);
    frames.iter().for_each(|f| assert_same_file(&format!("vtu/{f}")));
}

#[cfg(unix)]
#[test]
fn ctrl_c_writes_what_there_is() {
    for signal in ["INT", "TERM"] {
        let folder = scratch(&format!("interrupt-{signal}"));
        let scene = small(&folder);
        let out = folder.join("out");
        let child = command(&[
            "run",
            text(&scene),
            "--out",
            text(&out),
            "--set",
            "time.steps=100000000",
        ])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("starts");
        std::thread::sleep(std::time::Duration::from_millis(1500));
        let sent = std::process::Command::new("kill")
            .args([&format!("-{signal}"), &child.id().to_string()])
            .status()
            .expect("kill");
        assert!(sent.success());
        let done = child.wait_with_output().expect("ends");
        assert_eq!(done.status.code(), Some(130));
        let printed = String::from_utf8_lossy(&done.stdout);
        // A batch system sends SIGTERM, which nobody typed.
        assert!(
            printed.contains("interrupted,") && !printed.contains("Ctrl-C"),
            "{printed}"
        );
        let next = format!("next: arlequin resume {}\n", out.display());
        assert!(printed.ends_with(&next), "{printed}");
        let s = summary(&out);
        assert_eq!(s["status"], "interrupted");
        assert!(number(&s, "/steps") > 0.0 && number(&s, "/steps") < 1e8);
        assert!(out.join("results.pvd").exists() && out.join("plots/energy.svg").exists());
    }
}

/// The facts that matter come first, and no line is wider than a terminal.
#[test]
fn the_report_of_a_run_is_short_and_narrow() {
    let out = scratch("short-report").join("out");
    let scene = crate::common::scene("ball-impact.toml");
    let printed = succeed(&["run", text(&scene), "--out", text(&out)]);
    let lines: Vec<&str> = printed.lines().collect();
    let warnings = lines
        .iter()
        .skip_while(|l| !l.starts_with("warning"))
        .take_while(|l| !l.starts_with("energy"));
    let warnings = warnings.count();
    assert!(warnings > 0 && lines.len() - warnings <= 20, "{printed}");
    // A path is never split.
    let narrow = |l: &&str| l.chars().count() <= 80 || l.contains(text(&out));
    assert!(lines.iter().all(narrow), "{printed}");
    let s = summary(&out);
    let broken = number(&s, "/effect_ledger/1/facts/broken bonds");
    assert!(
        lines[0].starts_with("run        Ball on a silica block"),
        "{printed}"
    );
    let wanted = [
        "peak       below velocity ".to_owned(),
        format!("broken     {broken:.0} of "),
        "fragments  'grains' is in ".to_owned(),
        "warning    model 'grains': ".to_owned(),
        "energy     0 J at the start".to_owned(),
    ];
    let place = |start: &String| lines.iter().position(|l| l.starts_with(start.as_str()));
    let places: Vec<usize> = wanted.iter().filter_map(place).collect();
    assert!(places.len() == wanted.len() && places.is_sorted(), "{printed}");
    assert_eq!(
        lines.last(),
        Some(&format!("next: arlequin view {}", out.display()).as_str())
    );
    // The peak is that of the table.
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("probes");
    let column = table
        .lines()
        .skip(1)
        .filter_map(|l| l.split(',').nth(1)?.parse::<f64>().ok());
    let peak = column.map(f64::abs).fold(0.0, f64::max);
    let shown = lines[places[0]]
        .split_whitespace()
        .nth(3)
        .and_then(|x| x.parse::<f64>().ok());
    let shown = shown.expect("a number").abs();
    let unit = if lines[places[0]].contains(" mm/s at ") {
        1e-3
    } else {
        1.0
    };
    assert!(
        (shown * unit / peak - 1.0).abs() < 0.01,
        "{shown} {peak}: {printed}"
    );
    // So is the report of the shipped scene with the most to tell.
    let spalling = crate::common::scene("spalling.toml");
    let printed = succeed(&["run", text(&spalling), "--out", text(&out), "--force"]);
    let entries = printed
        .lines()
        .filter(|l| !l.starts_with("warning") && !l.starts_with(' '));
    assert!(
        entries.count() <= 20 && printed.contains("fragments  'grains'"),
        "{printed}"
    );
    // Everything else is there on request.
    let all = succeed(&["run", "--verbose", text(&scene), "--out", text(&out), "--force"]);
    assert!(all.lines().count() > lines.len() && crate::common::unwrapped(&all).contains("critical step"));
    let help = succeed(&["run", "--help"]);
    assert!(help.lines().all(|l| l.chars().count() <= 100), "{help}");
}

/// Issue 28: no warning stands twice in a log that has both streams, and the report alone has all of them.
#[cfg(unix)]
#[test]
fn warnings_stand_once_in_a_log_of_both_streams() {
    let folder = scratch("one-log");
    let scene = small(&folder);
    let path = folder.join("log");
    let log = std::fs::File::create(&path).expect("a log");
    let mut run = command(&["run", text(&scene), "--out", text(&folder.join("out"))]);
    let status = run
        .stdout(log.try_clone().expect("a copy"))
        .stderr(log)
        .status()
        .expect("runs");
    assert!(status.success());
    let both = crate::common::unwrapped(&std::fs::read_to_string(&path).expect("the log"));
    assert_eq!(both.matches("which reflects waves").count(), 1, "{both}");
    let report = succeed(&["run", text(&scene), "--out", text(&folder.join("again"))]);
    let report = crate::common::unwrapped(&report);
    assert_eq!(report.matches("which reflects waves").count(), 1, "{report}");
}

/// Returns the components of an array of a VTU file.
fn numbers(bytes: &[u8], wanted: &str) -> Vec<f64> {
    let (_, _, blocks) = arrays(bytes);
    let (.., block) = blocks.iter().find(|a| a.0 == wanted).expect("array");
    let eight = |b: &[u8]| f64::from_le_bytes(b.try_into().expect("eight bytes"));
    block.chunks_exact(8).map(eight).collect()
}

#[test]
fn a_body_in_steady_flight_is_written_with_its_velocity_and_its_way() {
    let folder = scratch("flight");
    let scene = folder.join("flight.toml");
    let head = SMALL.split("[[support]]").next().expect("models");
    let motion =
        "[[initial]]\nvelocity.uniform = [0.5, -2.0, 1.0]\n[time]\nsteps = 40\n[output]\nplots = false\n";
    std::fs::write(&scene, format!("{head}{motion}")).expect("scene");
    let out = folder.join("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let time = number(&summary(&out), "/time");
    for model in ["left", "right"] {
        let bytes = std::fs::read(out.join(format!("vtu/{model}_00000040.vtu"))).expect("frame");
        let displacement = numbers(&bytes, "displacement [m]");
        for (k, v) in numbers(&bytes, "velocity [m/s]").iter().enumerate() {
            let expected = [0.5, -2.0, 1.0][k % 3];
            assert!((v - expected).abs() < 1e-12, "{model}: {v} m/s, not {expected}");
            let way = expected * time;
            assert!(
                (displacement[k] - way).abs() < 1e-11,
                "{model}: {} m, not {way}",
                displacement[k]
            );
        }
    }
}
