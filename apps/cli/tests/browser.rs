//! Opens the report of a sweep and the page of a run in a headless browser: both must render, log nothing to
//! the console and request nothing from outside.
//!
//! Ignored by default, since a user's `cargo test` needs no browser. `.ci/run` installs one and runs `cargo
//! test --release --workspace --test browser -- --ignored`, which fails if there is none.

#[path = "it/common/mod.rs"]
mod common;

use common::browsers::{Browser, SIZES};
use common::sweeps::{SWEEP, folder};
use common::{arlequin, scene, scratch, succeed, text};
use serde_json::Value;
use std::path::PathBuf;

fn report(name: &str, sweep: &str) -> (PathBuf, Value) {
    let path = folder(name, sweep);
    let out = path.join("out");
    arlequin(&["sweep", text(&path.join("sweep.toml")), "--out", text(&out)]);
    let json = std::fs::read_to_string(out.join("sweep.json")).expect("sweep.json");
    (
        out.join("report.html"),
        serde_json::from_str(&json).expect("JSON"),
    )
}

#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn the_report_renders_without_complaint_and_asks_for_nothing() {
    let whole = report("browser-whole", SWEEP);
    let failing = report(
        "browser-failing",
        &SWEEP.replace("[[0.05, 1.2], ", "[[-1.0, 1.2], "),
    );
    assert_eq!(failing.1["status"], "failed");
    let mut browser = Browser::start(&scratch("browser-profile"));
    for (path, sweep) in [whole, failing] {
        for (width, phone) in SIZES {
            let seen = browser.visit(&path, width, phone);
            assert_eq!(
                seen.faults(),
                Vec::<String>::new(),
                "{} at {width} px",
                path.display()
            );
            assert_eq!(seen.words("title"), "Chain <and> bar");
            assert_eq!(seen.words("headline"), "Chain <and> bar");
            let runs = sweep["runs"].as_array().expect("runs");
            let labels: Vec<&str> = runs.iter().filter_map(|r| r["label"].as_str()).collect();
            assert_eq!(seen.list("rows"), labels);
            let conclusion = sweep["conclusion"].as_array().expect("conclusion");
            assert!(conclusion.len() >= 2);
            assert_eq!(
                seen.list("conclusion"),
                conclusion.iter().filter_map(Value::as_str).collect::<Vec<_>>()
            );
            assert_eq!(seen.page["pictures"].as_array().map(Vec::len), Some(3));
            let marks = |k: usize| seen.page["pictures"][k]["marks"].as_u64().unwrap_or_default();
            // Axes, ticks, legend and one mark per run.
            assert!((0..3).all(|k| marks(k) > 20), "{}", seen.page["pictures"]);
            assert!(!seen.words("body").contains("NaN"));
            if phone {
                assert_eq!(seen.list("cut"), Vec::<&str>::new(), "{}", path.display());
            }
        }
    }
}

/// Checks the checks: each faulty page has one defect, which is flagged, and a sound page has none.
#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn pages_that_misbehave_are_flagged() {
    let folder = scratch("browser-controls");
    let view = "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>";
    let cases = [
        ("good", view, "<p>text</p>", ""),
        ("error", view, "<script>console.error('ouch')</script>", "console"),
        ("warning", view, "<script>console.warn('hm')</script>", "console"),
        (
            "thrown",
            view,
            "<script>setTimeout(() => { throw new Error('late') }, 50)</script>",
            "console",
        ),
        (
            "outside",
            view,
            "<img style=\"width:300px;height:200px\" src=\"http://127.0.0.1:9/a.png\"/>",
            "request",
        ),
        ("missing", view, "<img src=\"missing.png\"/>", "picture"),
        (
            "empty",
            view,
            "<svg width=\"400\" height=\"300\" viewBox=\"0 0 400 300\"></svg>",
            "picture",
        ),
        ("wide", view, "<div style=\"width:3000px\">wide</div>", "overflow"),
        ("desktop", "", "<p>text</p>", "layout"),
    ];
    let mut browser = Browser::start(&folder.join("profile"));
    for (name, head, body, fault) in cases {
        let path = folder.join(format!("{name}.html"));
        let page = format!(
            "<!DOCTYPE html><html><head><link rel=\"icon\" href=\"data:,\"/>{head}<title>t</title></head><body>{body}</body></html>"
        );
        std::fs::write(&path, page).expect("writes");
        let faults = browser.visit(&path, 360, true).faults();
        let flagged = faults.iter().any(|f| f.starts_with(fault));
        assert!(
            if fault.is_empty() {
                faults.is_empty()
            } else {
                flagged
            },
            "{name}: {faults:?}"
        );
    }
}

/// Script that returns the share of the picture that is not background, its number of colours, and a sum that
/// tells two pictures apart.
const PIXELS: &str = "(() => {
    const from = document.getElementById('canvas'), to = document.createElement('canvas');
    [to.width, to.height] = [from.width, from.height];
    const c = to.getContext('2d');
    c.drawImage(from, 0, 0);
    const d = c.getImageData(0, 0, to.width, to.height).data, colours = new Set();
    let drawn = 0, sum = 0;
    for (let k = 0; k < d.length; k += 4) {
        if (d[k + 3] === 0) continue;
        drawn++;
        colours.add(d[k] >> 3 << 10 | d[k + 1] >> 3 << 5 | d[k + 2] >> 3);
        sum = (31 * sum + d[k] + 7 * d[k + 1] + 13 * d[k + 2] + k) % 1000003;
    }
    return { drawn: drawn / (to.width * to.height), colours: colours.size, sum };
})()";

/// Sets a control's value and dispatches its event, as a user would.
fn act(browser: &mut Browser, id: &str, value: &str, event: &str) {
    browser.value(&format!(
        "(() => {{ const e = document.getElementById('{id}'); e.value = '{value}'; e.dispatchEvent(new Event('{event}')); }})()"
    ));
}

#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn the_page_of_a_run_shows_it_at_desktop_and_phone_width() {
    let place = scratch("browser-view");
    let mut browser = Browser::start(&place.join("profile"));
    for (name, bonds) in [("quickstart", false), ("ball-impact", true)] {
        let out = place.join(name);
        succeed(&["run", text(&scene(&format!("{name}.toml"))), "--out", text(&out)]);
        succeed(&["view", text(&out)]);
        for (width, phone) in SIZES {
            let seen = browser.visit(&out.join("view.html"), width, phone);
            assert_eq!(seen.faults(), Vec::<String>::new(), "{name} at {width} px");
            assert_eq!(browser.value("document.body.dataset.ready"), "yes");
            browser.keep(&place.join(format!("{name}-{width}.png")));
            let outside = "['play', 'frame', 'time', 'field', 'canvas', 'legend'].filter(i => { const r = \
                           document.getElementById(i).getBoundingClientRect(); \
                           return r.left < 0 || r.right > innerWidth || r.width < 20; })";
            assert_eq!(
                browser.value(outside),
                serde_json::json!([]),
                "{name} at {width} px"
            );
            let look = |b: &mut Browser| b.value(PIXELS);
            let last = look(&mut browser);
            let share = last["drawn"].as_f64().expect("a share");
            assert!((0.03..0.9).contains(&share), "{name} at {width} px: {last}");
            assert!(
                last["colours"].as_u64() > Some(60),
                "{name} at {width} px: {last}"
            );
            // Every control changes what is seen.
            let mut sums = vec![last["sum"].clone()];
            for (id, value, event) in [
                ("frame", "3", "input"),
                ("field", "displacement", "change"),
                ("component", "0", "change"),
                ("warp", "90", "input"),
                ("cut", "x", "change"),
                ("at", "700", "input"),
            ] {
                act(&mut browser, id, value, event);
                let now = look(&mut browser)["sum"].clone();
                assert!(!sums.contains(&now), "{name} at {width} px: {id} changes nothing");
                sums.push(now);
            }
            browser.keep(&place.join(format!("{name}-{width}-cut.png")));
            let broken = "parts.reduce((n, p) => n + p.breaks.length, 0)";
            assert_eq!(browser.value(broken).as_u64() > Some(0), bonds, "{name}");
            browser.value("element('play').click()");
            browser.wait("state.frame !== 3");
            assert_eq!(
                browser.value("plots.length === about.plots.length && plots.length >= 2"),
                true
            );
        }
    }
}

/// Returns the page of a run of a shipped scene, and its summary.
fn page_of(place: &std::path::Path, name: &str) -> (PathBuf, Value) {
    let out = place.join(name);
    succeed(&["run", text(&scene(&format!("{name}.toml"))), "--out", text(&out)]);
    succeed(&["view", text(&out)]);
    (out.join("view.html"), common::summary(&out))
}

#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn a_page_opens_where_something_is_seen() {
    let place = scratch("browser-opens");
    let mut browser = Browser::start(&place.join("profile"));
    // The ball hides what it breaks, so the page cuts through it.
    let (impact, _) = page_of(&place, "ball-impact");
    assert_eq!(browser.visit(&impact, 1280, false).faults(), Vec::<String>::new());
    assert_eq!(browser.value("state.field"), "damage");
    assert_ne!(browser.value("state.cut"), "");
    let shown = browser.value("hotShare()").as_f64().expect("a share");
    act(&mut browser, "cut", "", "change");
    let whole = browser.value("hotShare()").as_f64().expect("a share");
    assert!(shown > 0.01 && shown > 3.0 * whole, "{shown} {whole}");
    // A mediator is a veil: its surface lets what is behind it through.
    let veil = "parts.filter(p => p.mediator).every(p => p.objects.faces.visible && p.objects.faces.material.transparent \
                && p.objects.faces.material.uniforms.opacity.value < 0.3)";
    assert_eq!(browser.value(veil), true);
    // A wave is largest before the last frame.
    let (wave, _) = page_of(&place, "struck-block");
    browser.visit(&wave, 1280, false);
    assert_eq!(browser.value("state.frame < about.times.length - 1"), true);
    assert!(browser.value("hotShare()").as_f64() > Some(0.0005));
    // What an address asks for is shown; what it cannot ask for is named and left out.
    let odd = "#cut=q&frame=3&field=nonsense&warp=x&view=1,2&range=0,5e7&only=1e6,&log&perspective";
    assert_eq!(
        browser.visit_part(&wave, odd, 1280, false).faults(),
        Vec::<String>::new()
    );
    assert!(browser.value(PIXELS)["drawn"].as_f64() > Some(0.03));
    let notices = browser.value("element('notices').innerText").to_string();
    for wrong in ["cut=q", "field=nonsense", "warp=x", "view=1,2"] {
        assert!(notices.contains(wrong), "{wrong}: {notices}");
    }
    let state = "[state.frame, state.span, state.high, state.least, state.logged, state.perspective]";
    assert_eq!(
        browser.value(state),
        serde_json::json!([3, "own", 50_000_000, 1_000_000, true, true])
    );
}

/// A block that flies by its own length is in the picture when the page opens.
#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn a_page_opens_with_a_moved_body_in_its_picture() {
    let place = scratch("browser-moved");
    let path = place.join("scene.toml");
    let block = r#"
[model.block]
kind = "fem"
shape.box = { low = [0.0, 0.0, 0.0], high = [1.0, 1.0, 1.0] }
spacing = 0.5
material = { young = 1.0, poisson = 0.2, density = 1.0 }
[[initial]]
velocity.uniform = [0.0, 0.0, 0.5]
[time]
end = 2.0
"#;
    std::fs::write(&path, block).expect("writes");
    let out = place.join("out");
    succeed(&["run", text(&path), "--out", text(&out)]);
    succeed(&["view", text(&out)]);
    let mut browser = Browser::start(&place.join("profile"));
    for (width, phone) in SIZES {
        let page = out.join("view.html");
        let faults = browser
            .visit_part(&page, "#field=displacement", width, phone)
            .faults();
        assert_eq!(faults, Vec::<String>::new(), "{width} px");
        let highest = "(() => { const p = parts[0], m = p.attributes.move.array, x = new THREE.Vector3(); let top = 0; \
                       for (let i = 0; i < p.count; i++) { \
                         x.set(...[0, 1, 2].map((c) => p.places[3 * i + c] + state.warp * m[3 * i + c])).project(camera); \
                         top = Math.max(top, Math.abs(x.x), Math.abs(x.y)); } return [top, Math.max(...m)]; })()";
        let seen = browser.value(highest);
        let [top, moved] = [0, 1].map(|k| seen[k].as_f64().expect("a number"));
        assert!(moved > 0.3 && (0.5..1.0).contains(&top), "{width} px: {seen}");
        browser.keep(&place.join(format!("moved-{width}.png")));
    }
}

/// Spheres that sleep are not drawn, and the zone grows from frame to frame; its mediator is left out.
#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn a_zone_that_follows_is_shown_as_it_goes() {
    let place = scratch("browser-follows");
    let mut browser = Browser::start(&place.join("profile"));
    let mut text_of_scene = std::fs::read_to_string(scene("following.toml")).expect("a shipped scene");
    for (from, to) in [
        ("spacing = 0.5e-3", "spacing = 0.7e-3"),
        ("end = 70e-6", "end = 18e-6"),
        ("amplitude = 4e-6", "amplitude = 6e-6"),
    ] {
        assert!(text_of_scene.contains(from), "{from}");
        text_of_scene = text_of_scene.replace(from, to);
    }
    let file = place.join("scene.toml");
    std::fs::write(&file, text_of_scene).expect("a scene");
    let out = place.join("out");
    succeed(&["run", text(&file), "--out", text(&out)]);
    let printed = common::unwrapped(&succeed(&["view", text(&out)]));
    assert!(printed.contains("'mediator-crack' is left out"), "{printed}");
    let page = out.join("view.html");
    assert_eq!(
        browser
            .visit_part(&page, "#view=0,0,1&field=", 1280, false)
            .faults(),
        Vec::<String>::new()
    );
    let awake = "parts.find(p => p.name === 'crack').objects.balls.geometry.index.count";
    let mut counts = [0, 0];
    for (count, frame) in counts.iter_mut().zip(["0", "about.times.length - 1"]) {
        browser.value(&format!("go({frame})"));
        *count = browser.value(awake).as_u64().expect("a number");
    }
    let summary = common::summary(&out);
    let ends = ["/conversions/0/spheres/0", "/models/1/nodes"].map(|p| common::number(&summary, p));
    // Of the overlap, those with less than half of the weight are left to the elements.
    assert!(
        counts[0] as f64 <= ends[0] && counts[0] as f64 > 0.3 * ends[0],
        "{counts:?} {ends:?}"
    );
    assert!(
        counts[1] as f64 <= ends[1] && counts[1] > counts[0] * 6 / 5,
        "{counts:?} {ends:?}"
    );
}

#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn the_controls_of_a_page_do_what_they_say() {
    let place = scratch("browser-controls-of-view");
    let mut browser = Browser::start(&place.join("profile"));
    let (page, summary) = page_of(&place, "notched-bend");
    assert_eq!(browser.visit(&page, 1280, false).faults(), Vec::<String>::new());
    // A click shows a particle; turning the body does not, and takes the sign away.
    let middle = "(() => { const r = element('canvas').getBoundingClientRect(); \
                  return [r.left + r.width / 2, r.top + r.height / 2]; })()";
    let middle = browser.value(middle);
    let middle = [0, 1].map(|c| middle[c].as_f64().expect("a number"));
    browser.drag(middle, middle);
    assert_eq!(browser.value("element('tip').hidden"), false);
    assert!(
        browser
            .value("element('tip').textContent")
            .to_string()
            .contains("grains, particle")
    );
    let turned = browser.value("camera.position.x");
    browser.drag(middle, [middle[0] + 60.0, middle[1] + 20.0]);
    assert_ne!(browser.value("camera.position.x"), turned);
    assert_eq!(browser.value("element('tip').hidden"), true);
    browser.value("look('iso')");
    let look = |b: &mut Browser| b.value(PIXELS)["sum"].clone();
    let mut sums = vec![look(&mut browser)];
    let mut changed = |b: &mut Browser, what: &str| {
        let now = look(b);
        assert!(!sums.contains(&now), "{what} changes nothing");
        sums.push(now);
    };
    act(&mut browser, "high", "0.2", "change");
    assert_eq!(
        browser.value(
            "[element('span').value, shared.range.value[1], element('legend').innerText.includes('0.2')]"
        ),
        serde_json::json!(["own", 0.2, true])
    );
    changed(&mut browser, "the entered range");
    browser.value("element('logged').click()");
    assert_eq!(browser.value("shared.logged.value"), 1);
    changed(&mut browser, "the logarithm");
    let kept = "parts.find(p => p.name === 'grains').objects.balls.geometry.index.count";
    let all = browser.value(kept).as_u64().expect("a number");
    act(&mut browser, "least", "0.2", "change");
    let damaged = "(() => { const p = parts.find(p => p.name === 'grains'); \
                   return p.attributes.value.array.filter((v, i) => v >= 0.2 && (!p.mine || p.mine.points[i])).length; })()";
    let few = browser.value(kept);
    assert_eq!(few, browser.value(damaged));
    assert!(
        few.as_u64() > Some(0) && few.as_u64() < Some(all / 2),
        "{few} of {all}"
    );
    changed(&mut browser, "the threshold");
    browser.value("element('perspective').click()");
    changed(&mut browser, "perspective");
    // A film has every frame, and leaves the page as it was.
    let before = browser.value("state.frame");
    let film = browser.value("film(60).then(f => [f.size, f.type])");
    assert!(
        film[0].as_u64() > Some(10_000) && film[1] == "video/webm",
        "{film}"
    );
    assert_eq!(browser.value("state.frame"), before);
    // Plots: each title once, the load curve among them, with its dot at the present frame.
    let captions = browser.value("[...document.querySelectorAll('figcaption')].map(c => c.textContent)");
    let captions: Vec<&str> = captions
        .as_array()
        .expect("titles")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    let distinct: std::collections::BTreeSet<_> = captions.iter().collect();
    assert_eq!(distinct.len(), captions.len(), "{captions:?}");
    assert!(
        captions[0].contains("load force [N] over") && captions[0].contains("deflection"),
        "{captions:?}"
    );
    let ink = "(() => { const c = plots[0].ctx.canvas, d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
               let [line, dot] = [0, 0]; \
               for (let k = 0; k < d.length; k += 4) { if (d[k + 3] < 200) continue; \
                 line += d[k] < 20 && d[k + 2] > 160; dot += d[k] > 200 && d[k + 2] < 20; } return [line, dot]; })()";
    let ink = browser.value(ink);
    assert!(ink[0].as_u64() > Some(100) && ink[1].as_u64() > Some(10), "{ink}");
    // Figures: peaks and broken bonds as in the summary.
    let figures = browser.value("element('figures').innerText").to_string();
    let broken = common::number(&summary, "/effect_ledger/0/facts/broken bonds");
    assert!(
        figures.contains(&format!("{broken:.0} of ")) && figures.contains("load force -"),
        "{figures}"
    );
}

#[test]
#[ignore = "needs a browser; .ci/run installs one and runs this"]
fn on_a_phone_the_picture_stays_while_controls_are_used() {
    let place = scratch("browser-phone");
    let mut browser = Browser::start(&place.join("profile"));
    let (page, _) = page_of(&place, "ball-impact");
    assert_eq!(browser.visit(&page, 390, true).faults(), Vec::<String>::new());
    for scroll in ["0", "1e6"] {
        browser.value(&format!(
            "document.querySelector('aside').scrollTop = {scroll}; document.scrollingElement.scrollTop = {scroll}"
        ));
        let seen = "['stage', 'bar'].every(i => { const r = element(i).getBoundingClientRect(); \
                    return r.top >= 0 && r.bottom <= innerHeight && r.height > 30; })";
        assert_eq!(browser.value(seen), true, "scrolled to {scroll}");
        browser.keep(&place.join(format!("phone-{scroll}.png")));
    }
    assert_eq!(
        browser.value("document.querySelector('aside').scrollTop > 300"),
        true
    );
    assert!(
        browser
            .value("element('notices').innerText")
            .to_string()
            .contains("crack ran into an overlap")
    );
}
