//! Images of every format, pages, masks.
#![no_main]

use libfuzzer_sys::fuzz_target;
use quadrille::io::images::{Accepted, PagedFile};

fuzz_target!(|data: &[u8]| {
    let Ok(mut file) = PagedFile::of("image".into(), data.to_vec()) else { return };
    let accepted = Accepted { max_mpx: 4, size: None };
    for page in file.images().unwrap_or_default().into_iter().chain([0]).take(4) {
        if let Ok(loaded) = file.read(page, accepted) {
            let pixels = loaded.image.width() * loaded.image.height();
            assert!(pixels > 0 && pixels <= 4_000_000);
            assert!(loaded.image.grey(loaded.image.width() - 1, loaded.image.height() - 1).is_finite());
        }
    }
});
