//! The scene parser on mutated scenes: text, spans of errors, assignments.

use arlequin_scene::{Scene, Source};
use reader_fuzz::Corpus;

reader_fuzz::counted!();

/// Parses a text, asks for spans, and renders the error as the program would; returns whether it was
/// accepted.
fn read(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return false;
    };
    let source = Source::new("fuzz.toml", text);
    for path in [
        "model",
        "model.left.shape.box.low[1]",
        "interface.middle",
        "time.end",
        "probe.a.at[9]",
    ] {
        let span = source.span_of(path);
        // A span off the character boundaries would panic when the error is shown.
        assert!(
            span.is_none_or(|s| text.get(s).is_some()),
            "the span of {path} cuts a character"
        );
    }
    for set in [
        &[][..],
        &["time.end=1e-3".to_owned()],
        &["a.b.c=1".to_owned(), "model=[]".to_owned()],
    ] {
        match Scene::from_source(source.clone()).and_then(|s| s.assign(set)) {
            Ok(_) if set.is_empty() => return true,
            Ok(_) => {}
            Err(e) => assert!(!e.to_string().is_empty()),
        }
    }
    false
}

#[test]
fn mutated_scenes_are_read_or_refused() {
    let _alone = ALONE.lock();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus");
    let mut seeds = Corpus::read(folder, "toml");
    seeds.extend(Corpus::read(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/scenes"),
        "toml",
    ));
    let corpus = Corpus {
        seeds,
        tokens: &[
            "[model.a]\n",
            "[[",
            "]]",
            "{",
            "}",
            "\"",
            "'''",
            "= ",
            "kind = \"fem\"\n",
            "role = \"fine\"\n",
            "1979-05-27",
            "é",
            "\\u0000",
            "inf",
            "nan",
            "0x",
            "_",
            "[model.a.shape]\n",
            "a.b.c.d = 1\n",
            "[[[[[[[[[[[[[[[[[[[[[[[[",
        ],
        floor: 4 << 20,
        // Text is parsed up to four times, and each table keeps its keys.
        per_byte: 4000,
    };
    corpus.run("scene", &allocated, &read);
}

/// Nested brackets of any depth are refused without a runaway recursion.
#[test]
fn deep_nesting_is_refused() {
    let _alone = ALONE.lock();
    for depth in [100, 1000, 100_000] {
        for (open, close) in [("[", "]"), ("{a=", "}")] {
            let text = format!("x = {}1{}", open.repeat(depth), close.repeat(depth));
            assert!(!read(text.as_bytes()), "{depth} of {open}");
        }
    }
}
