//! The case file of a virtual test.

use super::{ALUMINIUM, ELEMENT_PX, PIXEL_MM, VirtualTest, zones_px};
use crate::mechanics::Kinematics;
use crate::mechanics::cohesive::ExtendedXuNeedleman;

impl VirtualTest {
    /// A case file for `quadrille run`, as an experimenter would write it who knows nothing of the truth: it lies
    /// beside the folder `images` with `000000.png` and the frames.
    pub fn case_toml(&self) -> String {
        self.case_toml_with(&[])
    }

    /// The same that compares these laws, where there are some.
    pub fn case_toml_with(&self, laws: &[String]) -> String {
        let laws = if laws.is_empty() { String::new() } else { format!("laws = {laws:?}\n") };
        let [upper, lower] = zones_px();
        let [e, nu, sigma_0, alpha, n] = ALUMINIUM;
        // Of another law nobody knows an r: it is fitted with the rest.
        let r = self.options.law[3];
        let is_started = self.law.name() == ExtendedXuNeedleman::NAME;
        let exact_r = if is_started {
            "exact = true                          # and with this r; else state r_std = ...\n"
        } else {
            ""
        };
        let (fitted_r, start_r) = if is_started { ("", String::new()) } else { (", \"r\"", format!("r = {r:?}\n")) };
        // With small rotations the images themselves were computed.
        let rotations = if self.options.kinematics.is_small() { ", \"rotations\"" } else { "" };
        let kinematics = match self.options.kinematics {
            Kinematics::Paper => String::new(),
            other => format!("kinematics = {:?}                 # as the images were computed\n", other.name()),
        };
        format!(
            "# The virtual test. Run it with: quadrille run case.toml --output run\n\
             \n\
             [images]\n\
             reference = \"images/000000.png\"\n\
             deformed = \"images/*.png\"\n\
             pixel_size_mm = {PIXEL_MM}\n\
             \n\
             [camera]\n\
             exact = true                          # the images were computed without a lens\n\
             \n\
             [correlation]\n\
             element_size_px = {ELEMENT_PX}\n\
             \n\
             [[zone]]                              # below the adhesive; px of the reference image, y down\n\
             name = \"lower\"\n\
             roi = {lower:?}\n\
             \n\
             [[zone]]\n\
             name = \"upper\"\n\
             roi = {upper:?}\n\
             \n\
             [interface]\n\
             zones = [\"lower\", \"upper\"]            # thickness: the gap between their facing edges\n\
             guard_px = 3                          # pixels beside the dark adhesive that are left out\n\
             \n\
             [boundary]\n\
             remove_rigid_motion = \"none\"\n\
             \n\
             [substrate]\n\
             model = \"ramberg-osgood\"\n\
             plane = \"stress\"\n\
             E_MPa = {e:?}\n\
             nu = {nu:?}\n\
             sigma_0_MPa = {sigma_0:?}\n\
             alpha = {alpha:?}\n\
             n = {n:?}\n\
             exact = true                          # the images were computed with these very values; else state E_MPa_std = ...\n\
             \n\
             [cohesive]\n\
             model = \"extended-xu-needleman\"\n\
             phi_n_N_per_mm = 1.5\n\
             delta_n_mm = 0.0035\n\
             delta_t_mm = 0.07\n\
             {kinematics}r = {r:?}\n\
             {exact_r}\
             \n\
             [measurement]\n\
             nodes = \"free\"\n\
             weights = \"covariance\"\n\
             boundary = \"measured\"                 # or \"estimated\": its displacements as unknowns\n\
             \n\
             [fit]\n\
             parameters = [\"phi_n\", \"delta_n\", \"delta_t\"{fitted_r}]\n\
             {laws}\
             exact = [\"thickness\", \"faces\", \"pixel_size\"{rotations}]   # as the images were computed\n\
             \n\
             [fit.start]                           # N/mm, mm, mm\n\
             phi_n = 1.5\n\
             delta_n = 0.0035\n\
             delta_t = 0.07\n\
             {start_r}",
        )
    }
}
