//! The report of a packing: no mass moves without a message.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::float_cmp, reason = "counts are whole numbers")]

use crate::common::{arlequin, number, scene, scratch, succeed, summary, text, unwrapped};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;

/// Adds a cube of edge `a` at `low` as STL facets.
fn cube(low: f64, a: f64, out: &mut String) {
    let corner = |i: usize| {
        [
            low + (i & 1) as f64 * a,
            (i >> 1 & 1) as f64 * a,
            (i >> 2) as f64 * a,
        ]
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    for q in quads {
        for t in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
            out.push_str("facet normal 0 0 0\nouter loop\n");
            for [x, y, z] in t.map(corner) {
                writeln!(out, "vertex {x:e} {y:e} {z:e}").unwrap();
            }
            out.push_str("endloop\nendfacet\n");
        }
    }
}

fn stl(cubes: &[(f64, f64)]) -> String {
    let mut out = String::from("solid cubes\n");
    cubes.iter().for_each(|&(low, a)| cube(low, a, &mut out));
    out + "endsolid cubes\n"
}

fn write_scene(folder: &Path, body: &str, options: &str) -> String {
    let path = folder.join("scene.toml");
    let head = format!(
        "[model.body]\nkind = \"dem\"\n{body}\nmaterial = {{ young = 72.5e9, poisson = 0.17, density = 2200.0 }}\n"
    );
    let tail = "[time]\nsteps = 4\n[output]\nevery = 4\nplots = false\n";
    std::fs::write(&path, format!("{head}{options}{tail}")).unwrap();
    text(&path).to_owned()
}

fn refused(scene: &str) -> String {
    let out = arlequin(&["check", scene]);
    assert_eq!(out.status.code(), Some(2));
    // The terminal output may break words over lines.
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    text.split_whitespace()
        .filter(|w| *w != "│")
        .collect::<Vec<_>>()
        .join(" ")
}

const BOX: &str = "shape.box = { low = [0.0, 0.0, 0.0], high = [2e-3, 2e-3, 2e-3] }";

#[test]
fn two_cubes_in_one_stl_are_two_parts_with_the_mass_of_their_own_volume() {
    let folder = scratch("packings-two");
    std::fs::write(folder.join("two.stl"), stl(&[(0.0, 2e-3), (3e-3, 1e-3)])).unwrap();
    let dem = "dem = { count = 900, protocol = \"quench\" }";
    let scene = write_scene(&folder, &format!("shape.file = \"two.stl\"\n{dem}"), "");
    let plan: Value = serde_json::from_str(&succeed(&["check", &scene, "--json"])).unwrap();
    let out = folder.join("out");
    let table = unwrapped(&succeed(&["run", "--verbose", &scene, "--out", text(&out)]));
    for report in [&plan, &summary(&out)] {
        let packing_value = |key: &str| number(report, &format!("/models/0/packing/{key}"));
        assert!(
            packing_value("asked") == 900.0
                && packing_value("placed") == 900.0
                && packing_value("bodies") == 2.0
        );
        assert!(
            packing_value("parts/0/spheres") + packing_value("parts/1/spheres") + packing_value("dropped")
                == 900.0
        );
        for (k, volume) in [(0, 8e-9), (1, 1e-9)] {
            let mass = packing_value(&format!("parts/{k}/mass"));
            // Corners in a file have seven digits.
            assert!((mass / (2200.0 * volume) - 1.0).abs() < 1e-6, "{mass:e}");
        }
        assert!(
            (packing_value("mass_ratio") - 1.0).abs() < 1e-12
                && (packing_value("mass") / (2200.0 * 9e-9) - 1.0).abs() < 1e-6
        );
        assert!(
            (packing_value("coordination_all") - 6.2).abs() < 0.01
                && packing_value("coordination_retained") > 6.0
        );
        assert!(packing_value("coordination_interior") > 6.5);
        assert!((packing_value("void_fraction") - 0.38).abs() < 0.005 && packing_value("across") < 7.0);
    }
    assert!(table.contains("900 spheres asked, 900 placed"), "{table}");
    assert!(
        table.contains("2 parts in 2 bodies") && table.contains("in body 2"),
        "{table}"
    );
}

#[test]
fn loose_spheres_need_a_word_and_contact() {
    let folder = scratch("packings-loose");
    let dem = |keys: &str| {
        let list = format!("count = 400, protocol = \"quench\", coordination = 1.5{keys}");
        format!("{BOX}\ndem = {{ {list} }}")
    };
    let reason = refused(&write_scene(&folder, &dem(""), ""));
    assert!(
        reason.contains("of 400 spheres (") && reason.contains("of the volume, above 2.00 %)"),
        "{reason}"
    );
    let keep = dem(", loose = \"keep\"");
    let reason = refused(&write_scene(&folder, &keep, ""));
    assert!(
        reason.contains("model.body.dem.loose = keep: loose grains need contact"),
        "{reason}"
    );
    let without_contact = "[[effect]]\ncontact = {}\nenabled = false\n";
    assert!(refused(&write_scene(&folder, &keep, without_contact)).contains("loose grains need contact"));
    let with_contact = write_scene(&folder, &keep, "[[effect]]\ncontact = {}\n");
    let plan: Value = serde_json::from_str(&succeed(&["check", &with_contact, "--json"])).unwrap();
    assert!(number(&plan, "/models/0/nodes") == 400.0 && number(&plan, "/models/0/packing/grains") > 100.0);
    let table = unwrapped(&succeed(&["check", &with_contact]));
    assert!(
        table.contains("400 spheres asked, 400 placed, 0 dropped") && table.contains("loose grains"),
        "{table}"
    );
}

#[test]
fn islands_of_a_file_are_kept_and_a_shape_too_large_for_them_is_warned_of() {
    let folder = scratch("packings-islands");
    let mut rows = String::new();
    for (low, n) in [(0.0, [4, 4, 4]), (2e-3, [4, 4, 3])] {
        for k in 0..n[0] * n[1] * n[2] {
            let [i, j, l] = [k % n[0], k / n[0] % n[1], k / n[0] / n[1]].map(|c| 1e-4 + 2e-4 * f64::from(c));
            writeln!(rows, "{:e},{j:e},{l:e},1e-4", low + i).unwrap();
        }
    }
    std::fs::write(folder.join("islands.csv"), rows).unwrap();
    let shape = "shape.box = { low = [0.0, 0.0, 0.0], high = [2.8e-3, 0.8e-3, 0.8e-3] }";
    let dem = "dem = { file = \"islands.csv\", coordination = 4.4 }";
    let scene = write_scene(&folder, &format!("{shape}\n{dem}"), "");
    let plan: Value = serde_json::from_str(&succeed(&["check", &scene, "--json"])).unwrap();
    assert!(number(&plan, "/models/0/nodes") == 112.0);
    for (k, share) in [(0, 64.0 / 112.0), (1, 48.0 / 112.0)] {
        let mass = number(&plan, &format!("/models/0/packing/parts/{k}/mass"));
        assert!(
            (mass / (2200.0 * 2.8e-3 * 0.64e-6) - share).abs() < 1e-12,
            "{mass:e}"
        );
    }
    let warnings = plan.pointer("/warnings").unwrap().to_string();
    assert!(
        warnings.contains("are 2 parts that no bond joins (64, 48 spheres)"),
        "{warnings}"
    );
    assert!(
        warnings.contains("spheres fill 26.2 % of the shape"),
        "{warnings}"
    );
}

#[test]
fn millimetres_and_single_spheres_are_named_as_what_they_are() {
    let folder = scratch("packings-units");
    std::fs::write(folder.join("mm.stl"), stl(&[(0.0, 2.0)])).unwrap();
    let reason = refused(&write_scene(
        &folder,
        "shape.file = \"mm.stl\"\nspacing = 0.2e-3",
        "",
    ));
    assert!(
        reason.contains("fill the shape of 2.000e0 by 2.000e0 by 2.000e0 m")
            && reason.contains("a file in millimetres"),
        "{reason}"
    );
    let rod = |radius: &str| {
        format!(
            "shape.cylinder = {{ from = [0.0, 0.0, 0.0], length = 4e-3, radius = {radius} }}\nspacing = 0.2e-3"
        )
    };
    let reason = refused(&write_scene(&folder, &rod("0.1e-3"), ""));
    assert!(
        reason.contains("not one fits across") && reason.contains("check that lengths are in m"),
        "{reason}"
    );
    let reason = refused(&write_scene(&folder, &rod("0.2e-3"), ""));
    assert!(
        reason.contains("only 2.2 fit across; packings need three"),
        "{reason}"
    );
}

#[test]
fn a_needle_of_four_spheres_across_is_warned_of_with_what_to_expect() {
    let folder = scratch("packings-needle");
    let rod = |radius: f64| {
        let shape =
            format!("shape.cylinder = {{ from = [0.0, 0.0, 0.0], length = 3e-3, radius = {radius:e} }}");
        write_scene(
            &folder,
            &format!("{shape}\nspacing = 0.2e-3\ndem.protocol = \"quench\""),
            "",
        )
    };
    let plan = unwrapped(&succeed(&["check", &rod(0.4e-3)]));
    let wanted = "only 4.0 spheres fit across the body";
    assert!(plan.contains("bending -16 % and torsion -15 %"), "{plan}");
    assert!(plan.contains(wanted), "{plan}");
    let plan = unwrapped(&succeed(&["check", &rod(0.9e-3)]));
    assert!(!plan.contains("fit across the body"), "{plan}");
}

/// With seeds 0 and 16 the notch leaves a sphere without a bond; the sphere is removed with the notch, and
/// the scene is accepted.
#[test]
fn the_shipped_notched_bar_takes_loose_spheres_with_its_notch() {
    let path = scene("notched-bar.toml");
    for (seed, spheres) in [(0, 1.0), (16, 1.0), (1, 0.0)] {
        let set = format!("model.bar.dem.seed={seed}");
        let plan: Value =
            serde_json::from_str(&succeed(&["check", text(&path), "--set", &set, "--json"])).unwrap();
        let packing_value = |key: &str| number(&plan, &format!("/models/0/packing/{key}"));
        assert!(
            (packing_value("notch/spheres") - spheres).abs() < 0.5 && packing_value("notch/bonds") > 80.0,
            "{seed}"
        );
        let whole = 2200.0 * 12e-3 * 16e-6;
        assert!((packing_value("mass") + packing_value("notch/mass") - whole).abs() < 1e-12 * whole);
    }
}

/// Issue 28: spheres are packed anew only where the scene asks for another packing.
#[test]
fn changes_that_leave_the_packing_reuse_it() {
    let folder = scratch("packings-reused");
    let cache = folder.join("cache");
    let path = folder.join("scene.toml");
    let base = r#"
title = "a bar with a zone"
[body]
kind = "fem"
shape.box = { low = [0.0, 0.0, 0.0], high = [12e-3, 3e-3, 3e-3] }
spacing = 1e-3
material = { young = 70e9, poisson = 0.2, density = 2500.0 }
[zone.grains]
kind = "dem"
spacing = 0.6e-3
shape.box = { low = [-1.0, -1.0, -1.0], high = [3e-3, 1.0, 1.0] }
overlap.width = 3e-3
dem.protocol = "quench"
[[support]]
model = "body"
where = "x-max"
[time]
steps = 2
"#;
    let packings = |scene: &str, set: &[&str]| {
        std::fs::write(&path, scene).unwrap();
        let set: Vec<&str> = set.iter().flat_map(|s| ["--set", s]).collect();
        let mut check = crate::common::command(&[&["check", text(&path)], &set[..]].concat());
        let out = check.env("ARLEQUIN_CACHE", &cache).output().unwrap();
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{set:?}: {error}");
        std::fs::read_dir(&cache).unwrap().count()
    };
    assert_eq!(packings(base, &[]), 1);
    for set in [
        "title=other",
        "body.material={ young = 1e9, poisson = 0.25, density = 1000.0 }",
        "support.0.components=[\"x\", \"y\"]",
        "time.steps=5",
        "zone.grains.overlap.width=2.6e-3",
        "zone.grains.material={ young = 70e9, poisson = 0.2, density = 3000.0 }",
        "zone.grains.dem.young=2e11",
        "zone.grains.dem.finite_rotations=true",
        "zone.grains.dem.notch=[{ plane = { point = [1e-3, 0.0, 0.0], normal = [1.0, 0.0, 0.0], within = { low = [0.0, \
         0.0, 0.0], high = [2e-3, 1.5e-3, 3e-3] } } }]",
        "zone.grains.weight.profile=cubic",
        "zone.grains.mediator.spacing=0.5e-3",
        "zone.grains.step.ratio=2",
        "output.every=1",
    ] {
        assert_eq!(packings(base, &[set]), 1, "{set}");
    }
    let more = "[[effect]]\nfracture = { gc = 8.0 }\n[[effect]]\ncontact = { friction = 0.3 }\n[[load]]\nmodel = \"body\"\n\
                where = \"x-min\"\ntraction = [1e6, 0.0, 0.0]\ntime = \"step\"\n[[initial]]\nvelocity.uniform = [1.0, 0.0, 0.0]\n\
                [probe.p]\nmodel = \"grains\"\nwhere = \"x-min\"\ncomponent = \"x\"\n";
    assert_eq!(packings(&(base.to_owned() + more), &[]), 1);
    let rest = base.replace("[time]\nsteps = 2", "[static]\nsteps = 1");
    assert_eq!(packings(&rest, &[]), 1);
    // The control: each of these is another packing.
    for (k, set) in [
        "zone.grains.dem.seed=2",
        "zone.grains.spacing=0.55e-3",
        "zone.grains.overlap.width=4e-3",
    ]
    .iter()
    .enumerate()
    {
        assert_eq!(packings(base, &[set]), 2 + k, "{set}");
    }
}

#[test]
fn strength_of_beams_over_that_of_their_bar() {
    let flags = [
        "calibrate",
        "--box",
        "4e-3,1.5e-3,1.5e-3",
        "--protocol",
        "quench",
        "--seeds",
        "2",
        "--spacing",
        "2e-4",
    ];
    let wanted = [
        "--strength",
        "--criterion",
        "axial",
        "--sizes",
        "2.5e-4,2e-4",
        "--json",
    ];
    let report: Value = serde_json::from_str(&succeed(&[&flags[..], &wanted].concat())).unwrap();
    for k in 0..2 {
        let strength_value = |key: &str| number(&report, &format!("/strength/rows/{k}/{key}"));
        assert!(
            strength_value("ratio/mean") > 3.5 && strength_value("ratio/mean") < 5.0,
            "{report}"
        );
        assert!((strength_value("body/mean") * strength_value("ratio/mean") / 200e6 - 1.0).abs() < 0.01);
        assert!(strength_value("first/mean") < 1.0 && strength_value("broken/mean") > 0.0);
    }
    assert!(number(&report, "/strength/exponents/0/power").abs() < 1.0);
    for (flags, wanted) in [
        (&["--periodic", "--strength"][..], "strength is that of a bar"),
        (
            &["--box", "1,1,1", "--spacing", "0.1", "--strength", "--weibull=-1"],
            "--weibull = -1",
        ),
        (
            &["--box", "1,1,1", "--spacing", "0.1", "--strength", "--sizes", "0"],
            "--sizes = 0",
        ),
    ] {
        let out = arlequin(&[&["calibrate"], flags].concat());
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(
            out.status.code() == Some(2) && message.contains(wanted),
            "{message}"
        );
    }
}
