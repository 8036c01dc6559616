//! Two images: displacement with its uncertainty, strains, a table. It needs no feature of the crate:
//!
//!     cargo run --release --no-default-features --example pair                        # images made here
//!     cargo run --release --no-default-features --example pair -- ref.png def.png     # yours

use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{StrainDefinition, StrainField};
use quadrille::imaging::Image;
use quadrille::io::{csv::write_displacements, images::read_image};
use quadrille::mesh::{Roi, Zone};
use quadrille::synth::{Affine, RenderOptions, Texture, render};
use std::{error::Error, fs::File, path::Path, sync::Arc};

/// A speckle image whose material is stretched by `strain` along x.
fn speckles(strain: f64) -> Result<Image, Box<dyn Error>> {
    let stretched = Affine { gradient: [[strain, 0.0], [0.0, -0.3 * strain]], centre: [128.0, 96.0] };
    Ok(render(&Texture::new(1, 4.5)?, &stretched, &RenderOptions::new(256, 192))?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let (reference, deformed) = match files.as_slice() {
        [reference, deformed] => {
            (read_image(Path::new(reference), 0)?.image, read_image(Path::new(deformed), 0)?.image)
        }
        _ => (speckles(0.0)?, speckles(0.01)?),
    };
    // Elements of 16 px on all but the border: material near it may leave the image.
    let [x1, y1] = [reference.width(), reference.height()].map(|side| side as f64 - 16.0);
    let zone = Zone::rectangle("all", Roi { x0: 16.0, y0: 16.0, x1, y1 });
    let correlator = Correlator::new(CpuBackend::default(), Arc::new(reference), &[zone], Options::default())?;
    let found = correlator.correlate(Arc::new(deformed), None)?;
    let (field, strain) = (&found.measurement, StrainField::of(&found.measurement, StrainDefinition::default()));
    println!(
        "{}: {} iterations, residual {:.2} grey levels",
        field.status.name(),
        found.iterations,
        found.residual_rms
    );
    println!("node 0: u = {:?} px, standard uncertainty {:?} px", field.displacement[0], field.sigma[0]);
    let known: Vec<f64> = strain.elements.iter().flatten().map(|strain| strain.xx).collect();
    println!("exx = {:.5}, mean of {} elements", known.iter().sum::<f64>() / known.len() as f64, known.len());
    let table = std::env::temp_dir().join("quadrille_pair.csv");
    write_displacements(File::create(&table)?, &["an example".into()], field, Some(&strain), None)?;
    println!("all nodes: {}", table.display());
    Ok(())
}
