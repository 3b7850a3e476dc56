//! Property tests draw the same cases each time they run, unless the environment asks for others.

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The macro's name in two parts, so that this file holds no block without a configuration.
const MACRO: &str = concat!("proptest", "!");

fn draws() -> Vec<u64> {
    let drawn = RefCell::new(Vec::new());
    TestRunner::new(reader_fuzz::property_config(20))
        .run(&any::<u64>(), |x| {
            drawn.borrow_mut().push(x);
            Ok(())
        })
        .expect("nothing is refused");
    drawn.into_inner()
}

/// Prints drawn numbers, for the test below, which runs this one with other environments.
#[test]
fn drawn_numbers() {
    println!("drawn {:?}", draws());
    assert_eq!(draws(), draws());
}

#[test]
fn property_tests_draw_the_same_cases_each_time_and_others_for_another_seed() {
    let run = |seed: Option<&str>| {
        let mut test = Command::new(std::env::current_exe().expect("this test"));
        test.args(["--exact", "drawn_numbers", "--nocapture"]);
        test.env_remove("PROPTEST_RNG_SEED");
        test.envs(seed.map(|s| ("PROPTEST_RNG_SEED", s)));
        let output = test.output().expect("this test starts");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let (_, numbers) = text.split_once("drawn ").expect("numbers");
        numbers.lines().next().expect("a line").to_owned()
    };
    assert_eq!(run(None), run(None));
    assert_eq!(run(Some("7")), run(Some("7")));
    assert_ne!(run(None), run(Some("7")));
    assert_ne!(run(Some("8")), run(Some("7")));
}

/// Collects all Rust files below a folder except build output.
fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("folder").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() && name != "target" && !name.to_string_lossy().starts_with('.') {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Returns the number of blocks and runners of a file that draw from their own seed.
fn own_draws(text: &str) -> usize {
    let blocks = text.split(MACRO).skip(1);
    let configured = "#![proptest_config(";
    let blocks = blocks.filter(|block| {
        let first = block.trim_start_matches([' ', '{', '(', '\n']);
        let first = first.lines().next().unwrap_or_default();
        !(first.starts_with(configured) && first.contains("reader_fuzz::property_config("))
    });
    blocks.count() + text.matches("TestRunner::").count() + text.matches("Config::default()").count()
}

#[test]
fn every_property_test_has_the_configuration_with_a_fixed_seed() {
    let block = |config: &str| format!("{MACRO} {{\n    {config}\n    #[test]\n");
    assert_eq!(
        own_draws(&block("#![proptest_config(reader_fuzz::property_config(8))]")),
        0
    );
    assert_eq!(
        own_draws(&block("#![proptest_config(ProptestConfig::with_cases(8))]")),
        1
    );
    assert_eq!(own_draws(&block("#[doc(hidden)]")), 1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (mut files, mut blocks) = (Vec::new(), 0);
    sources(&root, &mut files);
    for path in files {
        // Deliberate exceptions: this crate's runner, whose seed is fixed as well, and this file.
        if path.starts_with(root.join("tests/reader-fuzz")) {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a text");
        blocks += text.matches(MACRO).count();
        if text.contains("proptest") {
            assert_eq!(
                own_draws(&text),
                0,
                "{}: reader_fuzz::property_config",
                path.display()
            );
        }
    }
    assert!(blocks >= 15, "only {blocks} blocks were looked at");
}
