//! Loads, motions and velocities as expressions and tables, and files of a run that can be read while it goes
//! on.
#![allow(clippy::float_cmp, reason = "the same load gives the same bits")]

use arlequin::core::Coupled;
use arlequin_scene::{Observer, Results, RunFolder, Scene, Silent};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

const BAR: &str = "[model.bar]\nkind = \"fem\"\nshape.bar = { from = 0.0, to = 1.0, section = 1e-4 }\nspacing = 0.1\n\
                   material = { young = 200e9, density = 7800.0 }\n\
                   [probe.tip]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponent = \"x\"\n\
                   [probe.hand]\nmodel = \"bar\"\nwhere = \"x-min\"\ncomponent = \"x\"\n";

fn run(text: &str) -> Results {
    let scene = Scene::from_text(format!("{BAR}{text}")).expect("a scene");
    scene.prepare().expect("built").run(&mut Silent).expect("runs")
}

fn moved(motion: &str) -> Results {
    run(&format!(
        "[[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\nmotion = {motion}\n[time]\nend = 2e-3\n"
    ))
}

#[test]
fn motions_by_expression_table_and_speed_go_where_they_should() {
    let follows = |motion: &str, wanted: &dyn Fn(f64) -> f64| {
        let results = moved(motion);
        let (times, values) = results.probe("hand").expect("probe");
        for (t, x) in times.iter().zip(values) {
            let error = (x - wanted(*t)).abs();
            assert!(error < 1e-13, "{motion}: at {t:e} s {x:e}, off by {error:e}");
        }
    };
    follows(
        "{ amplitude = 1e-3, time = { expression = \"(sin(PI*t/4e-3))^2\" } }",
        &|t| 1e-3 * (std::f64::consts::PI * t / 4e-3).sin().powi(2),
    );
    follows("{ speed = 0.25 }", &|t| 0.25 * t);
    follows("{ speed = 2.0, time = { ramp = { duration = 1e-3 } } }", &|t| {
        let inside = t.min(1e-3);
        2.0 * (0.5 * inside * inside / 1e-3 + (t - 1e-3).max(0.0))
    });
    follows("{ speed = 1.0, time = { expression = \"cos(1e3*t)\" } }", &|t| {
        (1e3 * t).sin() / 1e3
    });
    follows(
        "{ speed = 1.0, time = { table = [[0.0, 0.0], [1e-3, 1.0]] } }",
        &|t| {
            let inside = t.min(1e-3);
            0.5 * inside * inside / 1e-3 + (t - 1e-3).max(0.0)
        },
    );
}

/// The velocity of a motion is its time derivative without noise, also if it has a kink, a jump or many
/// periods.
#[test]
fn speeds_by_expression_are_smooth_in_time() {
    let wave = 2.0 * std::f64::consts::PI * 1e6;
    let formulas: [(&str, &dyn Fn(f64) -> f64); 3] = [
        ("min(1, t/1e-4)", &|t| (t / 1e-4).min(1.0)),
        ("step(t-1e-4)", &|t| f64::from(u8::from(t >= 1e-4))),
        ("sin(2*pi*1e6*t)", &|t| (wave * t).sin()),
    ];
    for (text, wanted) in formulas {
        let speed = format!(
            "[[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\nmotion = {{ speed = 1.0, time.expression = \"{text}\" }}\n\
             [probe.speed]\nmodel = \"bar\"\nwhere = \"x-min\"\ncomponent = \"x\"\nquantity = \"velocity\"\n\
             [time]\nend = 1.5e-4\nstep.seconds = 4e-8\n"
        );
        let results = run(&speed);
        let (times, values) = results.probe("speed").expect("probe");
        let dt = times[1] - times[0];
        for (t, v) in times
            .iter()
            .zip(values)
            .filter(|(t, _)| (**t - 1e-4).abs() > 2.0 * dt)
        {
            // Central differences of the displacement are off by (ω Δt)²/6.
            let allowed = if text.starts_with("sin") {
                (wave * dt).powi(2) / 6.0
            } else {
                1e-9
            };
            assert!((v - wanted(*t)).abs() < 1.1 * allowed, "{text} at {t:e} s: {v:e}");
        }
    }
}

/// A load given as a table, as a file and as an expression gives the same bits.
#[test]
fn loads_from_files_are_those_of_tables() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("over-time-files");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(
        folder.join("load.csv"),
        "time [s],share [-]\n0,0\n\n1e-4,0.5\n2e-4,1\n",
    )
    .expect("written");
    let load = |time: &str| {
        format!(
            "{BAR}[[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n\
             [[load]]\nname = \"pull\"\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1e3, 0.0, 0.0]\ntime = {time}\n\
             [probe.pull]\nof = \"pull\"\nquantity = \"force\"\ncomponent = \"x\"\n[time]\nend = 3e-4\n"
        )
    };
    let run = |name: &str, time: &str| {
        let path = folder.join(name);
        std::fs::write(&path, load(time)).expect("written");
        let scene = Scene::read(&path).expect("a scene");
        scene.prepare().expect("built").run(&mut Silent).expect("runs")
    };
    let table = run("table.toml", "{ table = [[0.0, 0.0], [1e-4, 0.5], [2e-4, 1.0]] }");
    let file = run("file.toml", "{ file = \"load.csv\" }");
    assert_eq!(table.recorded.probes.columns, file.recorded.probes.columns);
    // Spreadsheets put a byte-order mark before the first row, which holds numbers here.
    std::fs::write(folder.join("marked.csv"), "\u{feff}0,0\n1e-4,0.5\n2e-4,1\n").expect("written");
    let marked = run("marked.toml", "{ file = \"marked.csv\" }");
    assert_eq!(table.recorded.probes.columns, marked.recorded.probes.columns);
    let formula = run("formula.toml", "{ expression = \"min(1, t/2e-4)\" }");
    let [a, b] = [&table, &formula].map(|r| r.probe("pull").expect("probe").1.to_vec());
    assert!(
        a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9 && *a <= 1e3),
        "{a:?} {b:?}"
    );
}

#[test]
fn functions_of_time_that_make_no_sense_are_refused() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("over-time-bad");
    std::fs::create_dir_all(&folder).expect("a folder");
    let refused = |name: &str, table: &str, motion: &str, key: &str, words: &str| {
        std::fs::write(folder.join("bad.csv"), table).expect("written");
        let text = format!(
            "{BAR}[[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\nmotion = {motion}\n[time]\nend = 2e-3\n"
        );
        let path = folder.join(name);
        std::fs::write(&path, text).expect("written");
        let error = match Scene::read(&path).and_then(|s| s.prepare()) {
            Ok(_) => panic!("taken: {motion}"),
            Err(e) => e,
        };
        assert!(error.to_string().contains(words), "{error}");
        assert!(error.is_input(), "{error}");
        if !key.is_empty() {
            assert_eq!(error.place().0, Some(key), "{error}");
        }
    };
    let motion = "{ amplitude = 1.0, time = { file = \"bad.csv\" } }";
    let key = "support[0].motion.time.file";
    refused("a.toml", "0,0\n1,2,3\n", motion, key, "line 2: needs two numbers");
    refused("b.toml", "0,0\n0,1\n", motion, key, "line 2: times must rise");
    refused(
        "c.toml",
        "0,0\n1,x\n",
        motion,
        key,
        "line 2: is no row of finite numbers",
    );
    refused("d.toml", "t,x\n", motion, key, "has no row of numbers");
    // A first row that is meant as numbers is not taken for a header.
    refused("k.toml", "-1e-3,x\n0,0\n1,1\n", motion, key, "line 1: is no row");
    refused("l.toml", "t0,1.5\n0,0\n1,1\n", motion, key, "line 1: is no row");
    refused("e.toml", "0,inf\n", motion, key, "line 1");
    refused(
        "f.toml",
        "",
        "{ amplitude = 1.0, time = { file = \"none.csv\" } }",
        "",
        "none.csv",
    );
    let expression = "support[0].motion.time.expression";
    refused(
        "h.toml",
        "",
        "{ amplitude = 1.0, time = { expression = \"x\" } }",
        expression,
        "knows no 'x'",
    );
    refused(
        "i.toml",
        "",
        "{ amplitude = 1.0, time = { expression = \"1/t\" } }",
        expression,
        "is inf at t = 0e0 s",
    );
    refused(
        "m.toml",
        "",
        "{ amplitude = 1.0, time = { expression = \"min(1, 0/t)\" } }",
        expression,
        "is NaN at t = 0e0 s",
    );
    refused(
        "n.toml",
        "",
        "{ amplitude = 1.0, time = { expression = \"sqrt(1e-3-t)\" } }",
        expression,
        "is NaN at t = 1.002e-3 s",
    );
    refused(
        "j.toml",
        "",
        "{ amplitude = 1.0, speed = 1.0 }",
        "support[0].motion",
        "exactly one of amplitude",
    );
}

/// Observer that looks into the folder of a run while it goes on.
struct Peeping<'a> {
    folder: &'a Path,
    looks: usize,
}

impl Observer for Peeping<'_> {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        if run.steps() == 37 {
            let read = |name: &str| std::fs::read_to_string(self.folder.join(name)).expect("a file");
            let (probes, energy) = (read("probes.csv"), read("energy.csv"));
            // Frames come every ten steps, and rows are written with them at the latest.
            assert!((1 + 31..=1 + 38).contains(&probes.lines().count()), "{probes}");
            assert!(energy.lines().count() > 3);
            let width = probes.lines().next().expect("a headline").split(',').count();
            let whole =
                |l: &str| l.split(',').count() == width && l.split(',').all(|c| c.parse::<f64>().is_ok());
            assert!(probes.lines().skip(1).all(whole));
            let index = read("results.pvd");
            assert_eq!(index.matches("<DataSet").count(), 4, "{index}");
            assert!(index.trim_end().ends_with("</VTKFile>"));
            for file in index.split("file=\"").skip(1).filter_map(|f| f.split('"').next()) {
                assert!(self.folder.join(file).exists(), "{file}");
            }
            self.looks += 1;
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_run_can_be_read_while_it_goes_on() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("over-time-live");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    let text = format!(
        "{BAR}[[load]]\nmodel = \"bar\"\nwhere = \"x-max\"\nforce = [1e3, 0.0, 0.0]\ntime = \"step\"\n\
         [time]\nsteps = 60\n[output]\nevery = 10\n"
    );
    let scene = Scene::from_text(text).expect("a scene");
    let out = folder.join("out");
    let run_folder = RunFolder::new(&scene, Some(&out), true).expect("a folder");
    let mut peeping = Peeping {
        folder: &folder.join("out.unfinished"),
        looks: 0,
    };
    let results = scene
        .prepare()
        .expect("built")
        .run_into(run_folder, &mut peeping)
        .expect("runs");
    assert_eq!(peeping.looks, 1);
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("a table");
    assert_eq!(table.lines().count(), 1 + results.recorded.probes.times.len());
    assert!(!out.join("results.pvd.tmp").exists());
}
