//! Case files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use quadrille::io::case::{CaseDocument, parse_case, write_case};

fuzz_target!(|text: &str| {
    let path = "case.toml".as_ref();
    if let Ok(case) = parse_case(text, path) {
        // What is accepted can be written down and read again.
        let written = write_case(&case);
        let again = parse_case(&written, path).unwrap_or_else(|error| panic!("{error}\n{written}"));
        assert_eq!(again.zones.len(), case.zones.len());
    }
    if let Ok(document) = CaseDocument::parse(text, path) {
        let _ = document.joint();
    }
});
