//! A field as other programs lay out theirs.

use crate::field::{Measurement, StrainField, TensorStrain};
use crate::units::{PixelSize, Px};
use std::io::{self, Write};

/// A layout that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WrittenLayout {
    /// The nodemap of ARAMIS: mm, y up, strains in per cent.
    Nodemap,
    /// The table of VIC-2D: px, y down.
    Vic2d,
    /// The table of MatchID: px, y down.
    MatchId,
}

impl WrittenLayout {
    /// Whether it is in millimetres.
    pub fn needs_scale(self) -> bool {
        self == Self::Nodemap
    }

    fn columns(self) -> &'static str {
        match self {
            Self::Nodemap => {
                "ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; w [mm]; epsx [%]; epsy [%]; epsxy [1]"
            }
            Self::Vic2d => "\"x\",\"y\",\"u\",\"v\",\"sigma\",\"exx\",\"eyy\",\"exy\"",
            Self::MatchId => {
                "Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],disp.Horizontal Displacement U [Pixel],\
                 disp.Vertical Displacement V [Pixel],strain.Strain-global frame: Exx [ ],strain.Strain-global frame: \
                 Eyy [ ],strain.Strain-global frame: Exy [ ]"
            }
        }
    }
}

/// Writes the measured nodes of a field with their displacements as values at points, a row each, in the `layout` of
/// another program; a strain that is not known is `NaN`. `comments` stand before the names where the layout has room for
/// them. `scale` is for layouts in millimetres, whose origin is the centre of the top-left pixel.
///
/// Numbers are the shortest that read back to the same bits.
///
/// # Errors
/// Those of the writer; a layout in millimetres without scale.
pub fn write_points<W: Write>(
    mut out: W,
    layout: WrittenLayout,
    comments: &[String],
    measurement: &Measurement<Px>,
    strain: &StrainField,
    scale: Option<PixelSize>,
) -> io::Result<()> {
    let scale = match (layout.needs_scale(), scale) {
        (true, None) => return Err(io::Error::other("a nodemap is in mm; the run has no pixel size")),
        (true, Some(scale)) => scale.mm_per_px(),
        (false, _) => 1.0,
    };
    let head = if layout == WrittenLayout::Nodemap { "# " } else { "" };
    if layout == WrittenLayout::Nodemap {
        comments.iter().flat_map(|text| text.lines()).try_for_each(|line| writeln!(out, "# {line}"))?;
    }
    writeln!(out, "{head}{}", layout.columns())?;
    let strains = strain.nodes.iter().map(|strain| strain.map_or([f64::NAN; 3], TensorStrain::components));
    let nodes = measurement.mesh.nodes().iter().zip(&measurement.measured);
    let values = measurement.at_points().iter().zip(measurement.sigma_at_points()).zip(strains);
    let mut number = 0_usize;
    for ((&[x, y], &measured), ((&[u, v], sigma), [exx, eyy, exy])) in nodes.zip(values) {
        if !measured {
            continue;
        }
        number += 1;
        match layout {
            WrittenLayout::Nodemap => {
                // No minus before a zero.
                let up = |v: f64| 0.0 - v * scale;
                let [x, y, u, v] = [x * scale, up(y), u * scale, up(v)];
                let (exx, eyy, exy) = (100.0 * exx, 100.0 * eyy, 0.0 - exy);
                writeln!(out, "{number}; {x:?}; {y:?}; 0.0; {u:?}; {v:?}; 0.0; {exx:?}; {eyy:?}; {exy:?}")?;
            }
            WrittenLayout::Vic2d => {
                let sigma = (0.5 * (sigma.iter().map(|s| s * s).sum::<f64>())).sqrt();
                writeln!(out, "{x:?},{y:?},{u:?},{v:?},{sigma:?},{exx:?},{eyy:?},{exy:?}")?;
            }
            WrittenLayout::MatchId => writeln!(out, "{x:?},{y:?},{u:?},{v:?},{exx:?},{eyy:?},{exy:?}")?,
        }
    }
    out.flush()
}
