//! `arlequin view`: the page holds the content of the frames within the asked size, and names what it leaves
//! out.

use crate::common::{SMALL, arlequin, changed, scratch, succeed, text, written};
use serde_json::Value;
use std::path::Path;

/// Returns the data block of a page.
fn page_data(page: &Path) -> Value {
    let text = std::fs::read_to_string(page).expect("the page");
    let start = text.find("application/json\">").expect("data") + 18;
    let end = start + text[start..].find("</script>").expect("an end");
    serde_json::from_str(&text[start..end]).expect("JSON")
}

#[test]
fn a_page_holds_every_part_field_and_curve_and_asks_for_nothing() {
    let scene = written(
        "view-small",
        &changed(
            SMALL,
            &[(
                "[time]",
                "[curve.loop]\nx = \"tip\"\ny = \"tip\"\ny_factor = -1.0\n\n[output]\nevery = 10\n\n[time]",
            )],
        ),
    );
    let out = scene.with_file_name("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let printed = succeed(&["view", text(&out)]);
    assert!(
        printed.contains("written") && !printed.contains("notice"),
        "{printed}"
    );
    let page = out.join("view.html");
    let data = page_data(&page);
    assert_eq!(data["times"].as_array().map(Vec::len), Some(6));
    let parts = data["parts"].as_array().expect("parts");
    let names: Vec<&str> = parts.iter().filter_map(|p| p["name"].as_str()).collect();
    assert_eq!(names, ["left", "right", "mediator-joint"]);
    // 6 x 1 x 1 cubes: 28 nodes, 31 faces of four corners and two cells.
    assert_eq!(parts[0]["places"][1], 3 * 28);
    assert_eq!(parts[0]["faces"][1], 6 * 31);
    let field = |part: usize, name: &str| {
        let entries = parts[part]["fields"].as_array().expect("fields");
        entries
            .iter()
            .find(|f| f["name"] == name)
            .cloned()
            .unwrap_or_default()
    };
    let moved = field(1, "displacement");
    assert_eq!((&moved["frames"], &moved["components"]), (&6.into(), &3.into()));
    // Values that never change are stored once: here three numbers for 28 nodes.
    assert_eq!(field(0, "alpha")["values"][1], 28);
    let energy = crate::common::summary(&out);
    let tip = crate::common::number(&energy, "/probes/tip/max").abs();
    let largest = moved["high"][0].as_f64().expect("a number");
    assert!((largest / tip - 1.0).abs() < 0.2, "{largest} {tip}");
    let plots = data["plots"].as_array().expect("plots");
    let titles: Vec<&str> = plots.iter().filter_map(|p| p["title"].as_str()).collect();
    assert_eq!(titles, ["−tip displacement", "displacement", "energy", "work"]);
    assert_eq!(
        plots[0]["over"],
        serde_json::json!({ "title": "tip displacement", "unit": "m" })
    );
    // The peak of the table, which is the summary's largest value.
    let figure = data["figures"][0][1].as_str().expect("a figure");
    assert!(figure.starts_with("tip displacement "), "{figure}");
    let text_of_page = std::fs::read_to_string(&page).expect("page");
    for outside in ["src=\"", "href=\"http", "@import", "fetch("] {
        assert!(!text_of_page.contains(outside), "{outside}");
    }
    // A part whose points are others in a later frame is left out, and the rest is shown.
    let frames = out.join("vtu");
    let mut of_mediator: Vec<_> = std::fs::read_dir(&frames)
        .expect("frames")
        .map(|e| e.expect("a frame").path())
        .collect();
    of_mediator.retain(|f| f.to_string_lossy().contains("mediator-joint"));
    let last = of_mediator.iter().max().expect("a frame of the mediator");
    let of_left = last.to_string_lossy().replace("mediator-joint", "left");
    let frame = std::fs::read(last).expect("a frame");
    std::fs::copy(of_left, last).expect("another grid");
    let printed = crate::common::unwrapped(&succeed(&["view", text(&out)]));
    assert!(printed.contains("'mediator-joint' is left out"), "{printed}");
    assert_eq!(page_data(&page)["parts"].as_array().map(Vec::len), Some(2));
    std::fs::write(last, frame).expect("the frame as it was");
    // The page belongs to the results: it can be written again, and a new run replaces it.
    succeed(&["view", text(&out)]);
    succeed(&["run", text(&scene), "--out", text(&out), "--force"]);
    assert!(!page.exists());
}

/// A run that goes on has no summary, no table of fragments and perhaps half a frame.
#[test]
fn a_page_shows_a_run_that_goes_on_and_says_so() {
    let frames = changed(SMALL, &[("[time]", "[output]\nevery = 10\n\n[time]")]);
    let scene = written("view-goes-on", &frames);
    let out = scene.with_file_name("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let unfinished = scene.with_file_name("out.unfinished");
    std::fs::rename(&out, &unfinished).expect("renames");
    std::fs::remove_file(unfinished.join("summary.json")).expect("removes");
    std::fs::write(unfinished.join("vtu/right_00000050.vtu"), "<VTKFile>").expect("writes");
    let printed = crate::common::unwrapped(&succeed(&["view", text(&out)]));
    assert!(
        printed.contains("is not there yet") && printed.contains("the run goes on"),
        "{printed}"
    );
    let data = page_data(&unfinished.join("view.html"));
    assert_eq!(data["times"].as_array().map(Vec::len), Some(6));
    let parts = data["parts"].as_array().expect("parts");
    let kinds: Vec<&Value> = parts.iter().map(|p| &p["kind"]).collect();
    assert_eq!(kinds, [&Value::from("mesh"), &Value::from("mesh"), &Value::Null]);
    assert_eq!(data["title"], "out");
    assert!(data["notices"].to_string().contains("the run goes on"));
    assert!(
        data["figures"][0][1]
            .as_str()
            .is_some_and(|f| f.starts_with("tip displacement"))
    );
    // Without frames the curves are left, without curves nothing is.
    std::fs::remove_file(unfinished.join("results.pvd")).expect("removes");
    succeed(&["view", text(&out)]);
    let data = page_data(&unfinished.join("view.html"));
    assert!(data["parts"] == serde_json::json!([]) && data["notices"].to_string().contains("no frames"));
    for table in ["probes.csv", "energy.csv", "effects.csv"] {
        let _ = std::fs::remove_file(unfinished.join(table));
    }
    assert_eq!(arlequin(&["view", text(&out)]).status.code(), Some(2));
}

#[test]
fn a_small_page_leaves_out_frames_and_then_particles_and_says_so() {
    let out = scratch("view-thin").join("out");
    let scene = crate::common::scene("ball-impact.toml");
    succeed(&[
        "run",
        text(&scene),
        "--set",
        "time.end=2e-6",
        "--set",
        "output={ every = 1, fields = [\"displacement\", \"velocity\", \"weights\", \"energy-density\"] }",
        "--out",
        text(&out),
    ]);
    for plot in ["broken-bonds", "force-on-it", "displacement"] {
        let svg = std::fs::read_to_string(out.join(format!("plots/effect-{plot}.svg"))).expect(plot);
        assert!(svg.contains("grains/"), "{plot}");
    }
    let page = out.join("small.html");
    let printed = crate::common::unwrapped(&succeed(&[
        "view",
        text(&out),
        "--html",
        text(&page),
        "--megabytes",
        "1",
    ]));
    let data = page_data(&page);
    let part = |name: &str| {
        data["parts"]
            .as_array()
            .and_then(|p| p.iter().find(|p| p["name"] == name).cloned())
    };
    let grains = part("grains").expect("the particles");
    let shown = grains["radii"][1].as_u64().expect("a number");
    let total = crate::common::summary(&out)["models"][1]["nodes"]
        .as_u64()
        .expect("a number");
    assert!(shown < total && shown > total / 10, "{shown} of {total}");
    assert!(
        printed.contains("20 of") && printed.contains("particles are shown"),
        "{printed}"
    );
    assert_eq!(data["times"].as_array().map(Vec::len), Some(20));
    assert!(data["notices"].as_array().is_some_and(|n| !n.is_empty()));
    // Bonds that are shown join particles that are shown.
    let bonds = grains["lines"][1].as_u64().expect("a number");
    assert!(bonds > 0 && bonds % 2 == 0);
}

#[test]
fn what_is_no_result_is_refused_by_name() {
    let folder = scratch("view-bad");
    let refused = |arguments: &[&str]| {
        let out = arlequin(arguments);
        assert_eq!(out.status.code(), Some(2), "{arguments:?}");
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    let error = refused(&["view", text(&folder)]);
    assert!(
        error.contains("results.pvd") && error.contains("check the path"),
        "{error}"
    );
    let index = "<VTKFile><Collection><DataSet timestep=\"0\" part=\"0\" name=\"a\" file=\"a.vtu\"/></Collection></VTKFile>";
    std::fs::write(folder.join("results.pvd"), index).expect("writes");
    for content in ["", "<VTKFile>", "<VTKFile/><AppendedData encoding=\"raw\">_"] {
        std::fs::write(folder.join("a.vtu"), content).expect("writes");
        let error = refused(&["view", text(&folder)]);
        assert!(
            error.contains("a.vtu") && error.contains("no frame that 'arlequin run' wrote"),
            "{error}"
        );
    }
    std::fs::write(folder.join("mine.html"), "my own page").expect("writes");
    let error = refused(&["view", text(&folder), "--html", text(&folder.join("mine.html"))]);
    assert!(
        error.contains("--html") && error.contains("choose another place"),
        "{error}"
    );
}
