//! The mesh reader on mutated files, and on headers that announce more than the file holds.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use fem_ref::gmsh;
use reader_fuzz::Corpus;

reader_fuzz::counted!();

fn corpus() -> Corpus {
    Corpus {
        seeds: Corpus::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus"), "msh"),
        tokens: &[
            "$MeshFormat\n",
            "$EndMeshFormat\n",
            "4.1 0 8\n",
            "4.1 1 8\n",
            "4.1 1 4\n",
            "2.2 0 8\n",
            "2.2 1 8\n",
            "1 4 2 1 1 1 2 3 4\n",
            "1 11 2 1 1 ",
            "$Nodes\n",
            "$EndNodes\n",
            "$Elements\n",
            "$EndElements\n",
            "$Entities\n",
            "$EndEntities\n",
            "$PhysicalNames\n",
            "$EndPhysicalNames\n",
            "$Comments\n",
            "1 4 1 4\n",
            "3 1 4 1\n",
            "3 1 5 1\n",
            "\"name\"",
            "\r\n",
            " ",
            "\t",
            "\n",
        ],
        floor: 4 << 20,
        per_byte: 2000,
    }
}

#[test]
fn mutated_meshes_are_read_or_refused() {
    let _alone = ALONE.lock();
    corpus().run("gmsh", &allocated, &|bytes| gmsh::parse::<f64>(bytes).is_ok());
}

#[test]
fn headers_that_announce_too_much_are_refused_before_memory_is_taken() {
    let _alone = ALONE.lock();
    let many = "1000000000000";
    let file = |nodes: &str, block: &str, elements: &str, element_count: &str| {
        format!(
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {nodes} 1 4\n3 1 0 {block}\n1\n2\n3\n4\n0 0 0\n1 0 0\n\
             0 1 0\n0 0 1\n$EndNodes\n$Elements\n1 {elements} 1 1\n3 1 4 {element_count}\n1 1 2 3 4\n$EndElements\n"
        )
    };
    assert!(gmsh::parse::<f64>(file("4", "4", "1", "1").as_bytes()).is_ok());
    for text in [
        file(many, many, "1", "1"),
        file("4", many, "1", "1"),
        file("4", "4", many, many),
        file("4", "4", "1", many),
        file("4", "18446744073709551615", "1", "1"),
        file("4", "4", "1", "18446744073709551615"),
    ] {
        let before = allocated();
        let error = gmsh::parse::<f64>(text.as_bytes()).unwrap_err().to_string();
        let used = allocated() - before;
        assert!(error.contains("section"), "{error}");
        assert!(used < 1 << 20, "{used} bytes for '{error}'");
    }
}

/// Wrong counts of entities, physical names and blocks are refused before memory is allocated for them.
#[test]
fn counts_of_entities_are_not_believed() {
    let _alone = ALONE.lock();
    let seeds = corpus().seeds;
    let named = seeds
        .iter()
        .filter_map(|s| std::str::from_utf8(s).ok())
        .find(|s| s.contains("$Entities\n1 0 2 1"));
    let text = named.expect("a text with entities");
    for (from, to) in [
        ("$Entities\n1 0 2 1", "$Entities\n1 0 2 1000000000000"),
        ("$Entities\n1 0 2 1", "$Entities\n1000000000000 0 2 1"),
        ("$Nodes\n2 5 1 5", "$Nodes\n1000000000000 5 1 5"),
        ("$Elements\n4 5 1 5", "$Elements\n1000000000000 5 1 5"),
    ] {
        let broken = text.replace(from, to);
        assert_ne!(text, broken, "the corpus holds '{from}'");
        let before = allocated();
        assert!(gmsh::parse::<f64>(broken.as_bytes()).is_err(), "{to}");
        let used = allocated() - before;
        assert!(used < 1 << 20, "{used} bytes for {to}");
    }
}
