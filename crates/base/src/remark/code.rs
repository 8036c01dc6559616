//! All codes of remarks, with what they mean and what to do.

use serde::{Deserialize, Serialize};

/// How grave a remark is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Worth knowing.
    Note,
    /// A result may be wrong or worse than it looks.
    Warning,
    /// A result is missing.
    Error,
}

impl Severity {
    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// Makes the codes of a table: chapters, each with rows of variant, name, severity, title, meaning and remedy.
macro_rules! codes {
    ($($chapter:literal {
        $($code:ident $name:literal $severity:ident $title:literal $meaning:literal $remedy:literal;)*
    })*) => {
        /// The kinds of remarks.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[non_exhaustive]
        pub enum Code {
            $($(#[doc = $title] #[serde(rename = $name)] $code,)*)*
        }

        impl Code {
            /// All of them, in the order of the page on remarks.
            pub const ALL: &[Self] = &[$($(Self::$code),*),*];

            const CHAPTERS: &[(&'static str, &'static [Self])] = &[$(($chapter, &[$(Self::$code),*])),*];

            /// Name, severity, title, meaning, remedy.
            const fn row(self) -> (&'static str, Severity, [&'static str; 3]) {
                match self {
                    $($(Self::$code => ($name, Severity::$severity, [$title, $meaning, $remedy]),)*)*
                }
            }
        }
    };
}

codes! {
    "Files and images" {
        FilesLeftOut "files-left-out" Note
            "Files in the folder are left out."
            "A folder or pattern named files that are text or videos, or left some out for their capital letters."
            "Nothing, unless one of them should be an image.";
        OrderOfNames "order-of-names" Note
            "Numbers in the names set the order of the files."
            "Names have decimals, signs or units, which an order by letters takes apart. The text names the first files."
            "Check that the first one is the reference. `--reference` names another.";
        CamerasMixed "cameras-mixed" Warning
            "The names are those of two cameras."
            "Names end in two numbers in turn, and every instant has both. The motion between cameras is none."
            "Correlate each camera by itself, with the pattern that the text gives.";
        ImageFile "image-file" Note
            "How an image file was read."
            "The file has more pages, channels or bits than grey levels need, or its bits are not all used."
            "Check that the right page or channel was read. `--page` chooses another page.";
        ImageOdd "image-odd" Warning
            "The grey levels are not those of a picture."
            "The raw mosaic of a colour camera, two levels, or swapped bytes. Displacements are drawn to whole pixels or lost."
            "Save the images again, as the text says.";
        ImageSaturated "image-saturated" Warning
            "Many pixels are black or white."
            "More than 1 % of the pixels in the zones are at the end of the range of grey levels. They show no texture."
            "Change the exposure, or leave such places out of the zones.";
        LensUnknown "lens-unknown" Note
            "The camera is not stated, and a usual lens would be seen in this series."
            "A specimen that only moves seems to strain where the lens distorts. The text says what 0.1 % at the corner adds."
            "`quadrille calibrate` finds lens and tilt. `[camera] exact = true` says that there is none.";
        CameraOtherDay "camera-other-day" Note
            "The images were taken on another day than those of the calibration."
            "The times in the files of both say so. A lens that was touched since then is another one."
            "Calibrate again if lens, focus, aperture or distance may have changed.";
        DistanceChanged "distance-changed" Note
            "The distance from the camera to the specimen changed."
            "The zones of `[camera] still` are seen larger or smaller, by more than noise. It is taken off."
            "Nothing. Large changes come of a specimen or a camera that moves along the line of sight; a longer distance helps.";
        ScaleChanged "scale-changed" Note
            "All that is measured seems to grow, or to shrink, alike in all directions."
            "Heat and two equal loads do that. So does a distance to the camera that changed, which no image tells apart."
            "Name zones that do not deform in `[camera] still`, or say with `distance_std` by how much the distance may change.";
        StillZones "still-zones" Warning
            "Zones that should stay as they are do not, or are not measured."
            "The zones of `[camera] still` are strained by more than noise, or too few of their nodes are measured."
            "Name zones that do not deform, in the plane of the specimen. Give them a texture that can be measured.";
        ImageIncomplete "image-incomplete" Warning
            "An image is half black, torn, or incomplete."
            "Whole rows or columns have one grey level where the reference has texture."
            "Copy the file again, or leave the frame out.";
        HotPixels "hot-pixels" Note
            "Hot or dead pixels are mended."
            "Single pixels of the reference are far off their neighbours. What these say takes their place, also in images."
            "Nothing, unless the texture has dots of one pixel. Then use a lens that resolves them.";
        ReferenceBlurred "reference-blurred" Note
            "The images of the reference moved against each other."
            "The reference is the mean of several images that do not show the specimen at the same place."
            "Take reference images between which nothing moves.";
        ZoneFile "zone-file" Note
            "How a mask or mesh file was read."
            "The share of a mask that is white, or parts of a mesh file that are not used."
            "Check that the zones are where you want them.";
        FieldImported "field-imported" Warning
            "The fields were measured by another program."
            "Standard uncertainties are of single points as if these were independent. Points whose subsets overlap are not."
            "Take intervals of fitted parameters and of means as too narrow, or import points that are a subset apart.";
        ZonesFound "zones-found" Note
            "The zones were found in the reference."
            "No zone was named. The program measures where the reference shows enough texture."
            "Look at the picture of the mesh, or name zones with `--roi` or `[[zone]]`.";
        ZonesMatched "zones-matched" Note
            "Meshes of the two strips were matched to each other."
            "Nodes on the two faces of an adhesive must lie opposite each other. Edges of zones were moved for that."
            "Check the zones in the report.";
        CrackFound "crack-found" Note
            "A crack was looked for, or a drawn path was moved onto it."
            "Where a crack was found, in which frames none was found, or by how much the path was moved."
            "Check the path in the picture of the mesh, or give it in `[[crack]]`.";
    }
    "Device and folder" {
        DeviceChosen "device-chosen" Note
            "The CPU does the work."
            "There is no graphics device, or only one that is slower than the CPU."
            "Nothing. Results are the same.";
        DeviceFailed "device-failed" Warning
            "The graphics device failed."
            "The frame was measured again, on a fresh device or on the CPU."
            "Update the driver, or choose `--device cpu`.";
        DeviceWrong "device-wrong" Warning
            "The graphics device measured another field than the CPU."
            "One frame in some is measured on both. The CPU does the rest of the work."
            "Measure frames of this device again with `--device cpu`, and report the device.";
        NoLocks "no-locks" Warning
            "The file system has no locks."
            "Nothing keeps a second process from writing to the same folder."
            "Start one process at a time in this folder.";
        ReportMissing "report-missing" Warning
            "The report, or a part of it, could not be made."
            "The measurement is complete. Only the page is missing or has less to show."
            "Read the cause in the text, then use `quadrille view` or run the command again.";
        CurvesMissing "curves-missing" Warning
            "No curves were drawn from the fields."
            "The load file or the places do not fit the series that a camera gave."
            "Correct them and use `quadrille probe`.";
        FrameLate "frame-late" Warning
            "A frame arrived after another one although its name sorts before it."
            "Frames are numbered as they arrive."
            "Check the order before loads or times are joined by the number of the frame.";
        FolderUnreadable "folder-unreadable" Warning
            "The folder of the camera cannot be listed."
            "The program keeps trying."
            "Check the connection to the disk.";
    }
    "Mesh and reference" {
        NodesLeftOut "nodes-left-out" Warning
            "Nodes see too little texture and are left out."
            "Around these nodes the reference has no texture to measure with. They have no displacement in any frame."
            "Use larger elements, leave such places out of the zones, or improve the speckle.";
        NodesHeld "nodes-held" Note
            "Nodes see too little texture and are held by their neighbours."
            "A regularisation or splines give these nodes a displacement that is interpolated, not measured."
            "Do not read single values there.";
        ZoneLeftOver "zone-left-over" Note
            "Whole elements leave a strip of a rectangle over."
            "A rectangle holds as many whole elements as fit from its upper left corner. The rest is not measured."
            "Nothing, or make its sides a multiple of the element size.";
        BorderBare "border-bare" Warning
            "A zone borders on a place without texture."
            "What lies beyond the border is mixed into its outermost pixels and pulls the nodes there."
            "Leave these pixels out with `--guard 3` or `guard_px`.";
        HoleBare "hole-bare" Warning
            "Nodes are left out inside a zone along a place without texture."
            "What lies there pulls the nodes next to it, and no guard reaches it."
            "Leave the place out of the zone with `exclude` or `--mask`, and give a guard of 3 px.";
    }
    "A frame" {
        FrameUnreadable "frame-unreadable" Error
            "A frame could not be read or measured."
            "The file is missing, damaged, of another size, or shows nothing that can be measured. It has no field."
            "Replace the file and give the same command again, or leave the frame out.";
        TrackingRestarted "tracking-restarted" Note
            "The start from earlier frames failed."
            "The frame converged after a search without them."
            "Nothing. Many such frames mean that steps are large: take images more often.";
        TrackingLost "tracking-lost" Note
            "No start led to convergence."
            "Neither the start from earlier frames nor a search without them converged."
            "Take images more often, or use `update_reference` where the surface changes much.";
        ZoneLost "zone-lost" Warning
            "A zone was not found in a frame; the others were."
            "It is covered, has left the image, or has changed too much. The frame is `partly_lost`."
            "Look at the frame. Name the zones that matter, or leave this one out.";
        ReferenceRefused "reference-refused" Note
            "A frame could not become the new reference."
            "It shows too little texture or does not fit. The reference before it stays."
            "Check the image. Later frames are measured from an older reference.";
        NoiseContradicted "noise-contradicted" Warning
            "The stated noise is not the noise of the residual."
            "Standard uncertainties are made with the stated noise and are wrong by about this ratio."
            "Leave `noise` out so that it is estimated, or measure it again with `quadrille metrology`.";
        NoiseCorrelated "noise-correlated" Warning
            "The noise is not white."
            "Noise of neighbouring pixels is correlated. Standard uncertainties are multiplied by a factor for that."
            "Use raw images without sharpening or compression. Every frame has its own `noise_correlation_factor`.";
        FixedPattern "fixed-pattern" Warning
            "The pixels of the camera differ, by a pattern that does not move with the specimen."
            "It draws displacements below half a pixel towards zero. Static images cannot show it."
            "Correct the images by a flat and a dark one, or shift the specimen by some pixels after the reference.";
        NoiseBound "noise-bound" Warning
            "Some standard uncertainties are lower bounds."
            "Around these nodes the gradient of the reference is hardly more than noise."
            "Enlarge the elements, or average several images of the reference.";
        LightUnsettled "light-unsettled" Warning
            "Changes of brightness and contrast did not settle."
            "They vary over a zone and did not come to rest. Standard uncertainties do not include that."
            "Light the specimen more evenly, or leave out the place where it changes.";
        TextureRepeats "texture-repeats" Warning
            "The texture repeats."
            "The displacement is known only up to multiples of a period."
            "Give images between these, or mark the specimen with a texture that does not repeat.";
    }
    "A series" {
        SameAsReference "same-as-reference" Warning
            "Frames are the same image as the reference."
            "Neither displacement nor noise is measured there."
            "Leave these frames out.";
        FramesCopied "frames-copied" Warning
            "Frames are copies of the same file."
            "The camera or a script wrote one image several times."
            "Leave the copies out.";
        FramesOfOtherSize "frames-of-other-size" Warning
            "Images are not as large as the reference."
            "They cannot be measured from it: another camera, a crop, or a picture of the set-up."
            "Leave them out; where all differ, name another reference.";
        FramesMissing "frames-missing" Warning
            "The numbers in the names of the frames have gaps."
            "A frame that was dropped shifts the loads and times of those after it."
            "Give loads and times by a column `frame` or by time.";
        TimesOutOfOrder "times-out-of-order" Warning
            "The times in the files contradict the order of the frames."
            "Frames stand at another place of the series than the time when they were taken."
            "Give the files in the order of the test.";
        FramesShuffled "frames-shuffled" Warning
            "The frames are not in the order of their names."
            "In the order of the names the motion goes a much shorter way."
            "Give the files in the order of the test, or a pattern in quotes.";
        FrameOutOfOrder "frame-out-of-order" Warning
            "One frame seems to be out of order."
            "Without it the motion goes a much shorter way."
            "Check its file and its place.";
        OrderRandom "order-random" Warning
            "The motion jumps as in a random order."
            "Steps between frames are as large as between any two frames."
            "Give the files in the order of the test.";
        OrderReversed "order-reversed" Warning
            "The series fits better the other way round."
            "The motion grows from the last image and not from the reference."
            "If the last image shows the specimen before the test, name it with `--reference`.";
        ReferenceApart "reference-apart" Warning
            "The reference is far away from all other images."
            "The other images are close to each other. Perhaps another one is the reference."
            "Name the reference with `--reference FILE`.";
        NodesInNoise "nodes-in-noise" Warning
            "Nodes are not measured because of noise."
            "Their texture does not stand out of the noise that the residual shows."
            "Use larger elements, more light, or the mean of several reference images.";
        StrainFlattened "strain-flattened" Warning
            "Windows flatten the strain."
            "In more than 5 % of the windows the model error of the strain is above three standard uncertainties."
            "Use a smaller `--strain-window`, as the remark says, or smaller elements. Read strains with their model error.";
    }
    "Loads and quantities" {
        LoadConverted "load-converted" Note
            "How the load file was read."
            "Units that were converted, columns that were computed, and where times are counted from."
            "Check that the units are those of the file.";
        LoadOutside "load-outside" Warning
            "Frames lie outside the load record."
            "They were taken before it begins or after it ends. Their cells are empty."
            "Check the start time and the interval of the frames.";
        CellsEmpty "cells-empty" Note
            "Cells of a table are empty."
            "A place lies outside the mesh or on nodes that are not measured, or a frame has no field."
            "Move the place, or accept the gap.";
        TensionBent "tension-bent" Warning
            "A line of the tensile test is bent within its range."
            "The slope changes clearly from one end to the other. A modulus of such a range is a mean over it."
            "Give a range that is straight: `[tension] modulus_range` or `r_range`.";
        TensionMissing "tension-missing" Note
            "A constant of the tensile test is missing."
            "The text names it and says what is lacking: a force, an area, frames in the range, a strain across."
            "Give what is lacking, or do without it.";
        CrackTip "crack-tip" Note
            "What to know of a crack that was followed."
            "It is open to the end of its path, was followed node by node, or lacks a stress intensity."
            "Read `mark` in cracks.csv. Lengthen the path if the crack is open to its end.";
    }
    "A joint and its model" {
        FramesLeftOut "frames-left-out" Warning
            "Frames did not converge and are left out."
            "Instants are counted without them."
            "See the report of the correlation.";
        BorderFree "border-free" Warning
            "Nodes of the outer border are left free."
            "The table of the border does not prescribe them, or, of one body, some frame has lost them."
            "Measure the whole border, with the end nodes of the faces of the adhesive. At a free edge nothing is wrong.";
        RigidMotionRemoved "rigid-motion-removed" Warning
            "The overall rigid motion is taken off."
            "With kinematics = \"paper\" this changes the sliding jump."
            "Take kinematics = \"finite\", or compare with remove_rigid_motion = \"none\".";
        LengthsApart "lengths-apart" Warning
            "Lengths do not fit together."
            "Elements, the border's motion or the size of the joint differ from the law's lengths by a large factor."
            "Give all lengths in mm.";
        RotationLarge "rotation-large" Warning
            "A strip rotates too much for small rotations."
            "The rotation makes a strain of more than a tenth of the yield strain."
            "Take kinematics = \"finite\".";
        StrainBeyondCurve "strain-beyond-curve" Warning
            "The plastic strain exceeds the curve of the material."
            "Beyond its last point the curve is continued with its last slope."
            "Measure the material to larger strains.";
        PairsClose "pairs-close" Warning
            "Node pairs close again after their peak."
            "The law returns along its curve, where a damaged adhesive would unload."
            "Do not use instants after this one to judge the law.";
        PathGoesBack "path-goes-back" Warning
            "The path of the solution goes back."
            "No test shows this part. A real specimen snaps over it."
            "Nothing. Compare with the part that a test shows.";
        PathEnded "path-ended" Warning
            "The path ended before its last instant."
            "The joint is broken, the path was lost, or the limit of points was reached."
            "Use a smaller step or more `max_points` in `[path]`.";
        FigureMissing "figure-missing" Warning
            "A figure of an instant without solution was requested."
            "The instant did not converge or was not reached."
            "Name other instants in `[output] figures`.";
    }
    "Values that hardly occur" {
        MaterialImplausible "material-implausible" Warning
            "A property of the strips that hardly any material has."
            "Mostly a wrong unit or a wrong row of a table."
            "Give moduli and stresses in MPa, and check the value.";
        LengthImplausible "length-implausible" Warning
            "A thickness or a scale that hardly any joint has."
            "Mostly a wrong unit or a wrong scale."
            "Check `pixel_size_mm` and the thickness. All lengths are in mm.";
        StartImplausible "start-implausible" Warning
            "The law at the start is far from the jumps of the joint."
            "The joint opens much less or much more than the law's own lengths."
            "Give all lengths in mm, or start values nearer to the adhesive.";
        LawImplausible "law-implausible" Warning
            "A fitted law that hardly any adhesive has."
            "Tractions that the strips cannot carry, or works of separation of no bond."
            "Check units of moduli and lengths.";
        LawHardlyLoaded "law-hardly-loaded" Warning
            "The test hardly loaded the adhesive."
            "The joint did not reach a tenth of the jump at the largest traction. The rest of the law is extrapolated."
            "Load further, or believe the first slope only.";
        LawExtrapolated "law-extrapolated" Note
            "A good part of the law's work lies beyond what any pair of the joint reached."
            "Works of separation then follow from the shape of the law, and their intervals suppose that it is true."
            "Publish `work_reached`, the work as far as the test went; or load further.";
    }
    "The case of a fit" {
        KeyUnused "key-unused" Warning
            "A key of the case has no effect."
            "The text says which key, and what takes its place."
            "Take it out of the case file.";
        LawOwnMinima "law-own-minima" Warning
            "Fits of this law end in one of several minima."
            "Intervals belong to the minimum found and hold the truth less often than they say."
            "Fit from other start values before you believe them.";
        InstantsNotCompared "instants-not-compared" Warning
            "Instants are computed and not compared."
            "They are not in the table of measured displacements."
            "Nothing, if you left them out on purpose.";
        NodesNotCompared "nodes-not-compared" Warning
            "Nodes are not compared."
            "They are prescribed, or were not measured in every frame."
            "Nothing, if enough nodes are left.";
        NodesUnmeasured "nodes-unmeasured" Warning
            "Weights are made from some of the nodes only."
            "The paper's weights need the largest displacement. That of nodes without a measurement is not known."
            "Measure more nodes, or give weights = \"uniform\".";
        BorderNotSmooth "border-not-smooth" Warning
            "Smooth fields do not describe the border."
            "What smoothing leaves of the measured border is more than its noise: steps, or a noise that is larger than stated."
            "Look for steps and badly measured nodes along the border; or give border = \"free\".";
        WeightsShifted "weights-shifted" Warning
            "The weights of instants count converged frames only."
            "After a frame that did not converge, the weights belong to later frames than their places say."
            "Leave the entries of such frames out of `instant_weights`.";
        NormalMatrixMissing "normal-matrix-missing" Warning
            "The store holds no normal matrix."
            "It was made by an earlier version, or brightness was found for each element. The covariance is that of an even texture."
            "Correlate again, without brightness = \"element\".";
        ReferenceLater "reference-later" Warning
            "Instants were measured from a later reference."
            "Their covariance is taken to be that of the first reference. Their real uncertainties are larger."
            "Use frames that were measured from the first reference, if they suffice.";
        ForceUnknown "force-unknown" Warning
            "No force is known at some instants."
            "The load file has no value there. These instants are compared without a force."
            "Check the times or frame numbers of the load file.";
        ForceTurned "force-turned" Warning
            "The direction of the force is not turned with the joint."
            "The rigid motion that is subtracted rotates, and the force does not."
            "Give remove_rigid_motion = \"none\".";
        ForceOpposite "force-opposite" Warning
            "The measured force has the opposite sign of the computed one."
            "The direction or the group of nodes is the wrong one."
            "Reverse `[force] direction`, or name another group.";
        ForceScaled "force-scaled" Warning
            "The measured force takes another course than the computed one."
            "The text names what would bring them together: a width, moduli, a zero of the load cell, its time."
            "Check that, the unit of the load, and whether the model holds all of the joint.";
        ReductionSlack "reduction-slack" Note
            "The curve of a reduced test begins beside the origin."
            "Pins and grips settle before the load rises. The displacement at no load, by the straight part, is taken off."
            "Nothing, if it is slack; else look at the zero of load and displacement.";
        ReductionUnloading "reduction-unloading" Note
            "The joint closes at some instants."
            "J and its derivative belong to a joint that opens. These instants are left out of the traction and of means."
            "Nothing, for a test with unloading cycles.";
        ReductionFalls "reduction-falls" Warning
            "J falls while the joint opens."
            "The traction is the slope of J and is not negative. A load or a rotation is wrong, or the front is not straight."
            "Check the sections where loads act, the width, and the column of the load.";
        ReductionJump "reduction-jump" Note
            "The load of a reduced test falls at once."
            "The crack jumped: growth was not stable. J before the jump is of its begin, after it of its arrest."
            "Report begin and arrest apart; more images about the jump do not help.";
        ReductionSmeared "reduction-smeared" Warning
            "The peak of the traction is not told."
            "Separations at the tip are as uncertain as the peak is far from the origin: a slope over them is flatter and wider than the law. J and work are not touched."
            "Move the camera nearer to the tip, or take better images.";
        ReductionUnseen "reduction-unseen" Warning
            "A section where a load acts is not measured in any frame."
            "J by loads and rotations, and the displacement of the load, need all of them."
            "Draw the region over a zone that is in view, or leave `sections` out and name the machine's displacement.";
        ReductionUneven "reduction-uneven" Warning
            "The two arms of a reduced test turn by different angles."
            "Beam methods take arms alike; J by loads and rotations does not."
            "Check the thickness of both arms, and whether the specimen turns as a whole; trust J.";
        DirectLawDiffers "direct-law-differs" Warning
            "The fitted law and the slope of J differ by more than both their bands."
            "The fit assumes one shape of the law all along the joint, and the strips as stated; the slope of J assumes straight fronts and the loads as named."
            "Look where they differ: in the tail another law may fit (compare laws); at the origin look at r and the thickness; everywhere at width and load.";
        ReductionDisagree "reduction-disagree" Warning
            "Methods give different energy release rates."
            "J by loads and rotations assumes least. Beam methods take moduli, arm and crack as stated and no long fracture zone."
            "Trust J, where rotations are seen; check E, arm and crack.";
        ScalesDiffer "scales-differ" Warning
            "A test has two scales."
            "Its mesh and its `[measurement]` state different sizes of a pixel."
            "Correct the one that is wrong.";
        DataTwice "data-twice" Warning
            "Two tests hold the same displacements."
            "One measurement counts twice, and uncertainties are too small."
            "Take one of the tests away.";
        ThicknessDiffers "thickness-differs" Warning
            "The adhesive has another thickness in two tests."
            "One law is fitted to both, although it may depend on the thickness. Perhaps a unit is wrong."
            "Check the lengths. Fit tests of one thickness together.";
        StiffnessDiffers "stiffness-differs" Warning
            "Strips of two tests have very different moduli."
            "Perhaps a modulus is in another unit."
            "Give all moduli in MPa.";
        UncertaintiesDiffer "uncertainties-differ" Warning
            "Tests state different uncertainties of one parameter."
            "The larger one is used for all tests."
            "State one value.";
    }
    "The result of a fit" {
        FitCutShort "fit-cut-short" Warning
            "The fit was ended early."
            "A limit of time or evaluations was reached, or the fit was stopped. Parts of the result are missing."
            "Give more time and fit again.";
        EffectMissing "effect-missing" Warning
            "The effect of a constant or of the element size could not be computed."
            "The intervals do not include it."
            "Check whether the model has a solution near the result, or on a finer mesh.";
        ParameterOnBound "parameter-on-bound" Warning
            "A parameter ended on its bound."
            "Its interval means little."
            "Widen the bounds, or prescribe the parameter.";
        SolutionRescued "solution-rescued" Warning
            "The forward run at the result was rescued."
            "Node pairs snapped. The objective may jump near the result."
            "Use more instants or a finer mesh.";
        IntervalsInDoubt "intervals-in-doubt" Warning
            "Linear theory may not describe the intervals."
            "Uncertainties are large, or noise acts in a way that is not linear. The text says what was done about it."
            "Use intervals = \"profile\", or measure with less noise.";
        NoiseBiases "noise-biases" Warning
            "Noise shifts a parameter on average."
            "The value is as fitted. Its interval includes the shift."
            "Measure with less noise, or more frames.";
        IntervalOpen "interval-open" Warning
            "An interval has no end on one side."
            "The objective does not rise enough there, or the model has no solution on the way."
            "The data do not determine the parameter on this side. Prescribe it, or measure more.";
        RotationsMatter "rotations-matter" Warning
            "Finite rotations would change the parameters."
            "The fit assumes small rotations. The text says by how much the parameters would change."
            "Take `[cohesive] kinematics = \"finite\"`.";
        StartsDiffer "starts-differ" Warning
            "Starts led to different ends."
            "The objective has several minima. The best one was taken."
            "Add starts, and compare the ends in fit.json.";
    }
}

impl Code {
    /// Its name in files.
    pub const fn name(self) -> &'static str {
        self.row().0
    }

    /// How grave its remarks are.
    pub const fn severity(self) -> Severity {
        self.row().1
    }

    /// What is the matter, in a sentence.
    pub const fn title(self) -> &'static str {
        self.row().2[0]
    }

    /// What that means.
    pub const fn meaning(self) -> &'static str {
        self.row().2[1]
    }

    /// What to do.
    pub const fn remedy(self) -> &'static str {
        self.row().2[2]
    }
}

/// How the page on remarks begins.
const HEAD: &str = r#"# Remarks

<!-- Made by `quadrille about remarks > docs/remarks.md`; a test compares. -->

What a run has to say about its results. Every remark has a code, which stays when its words change.
Files hold remarks under the key `remarks`: `summary.json` (of the run and of each frame or instant), `fit.json` and
`tournament.json`.

```json
{"code": "nodes-in-noise", "severity": "warning", "about": {"frames": [2, 4]}, "values": {"nodes": 7}, "text": "..."}
```

- `severity`: `note` (worth knowing), `warning` (a result may be wrong or less exact than it looks), `error`.
- `about`: what it is about: `"run"`, `{"frames": [2, 4]}`, `{"zone": "left"}`, `{"parameter": "E"}` and so on.
- `values`: the numbers of the text by name, which ends in the unit. Absent if there are none.
- `text`: the sentence for people. It may change between versions.

A fit takes over the warnings of its correlation. Of several tests, `values` holds the name of the `test`.

`quadrille about remarks` writes this page.
"#;

/// The page on all codes, as Markdown: `docs/remarks.md`.
pub fn remark_reference() -> String {
    let mut page = HEAD.to_owned();
    for (chapter, codes) in Code::CHAPTERS {
        page.push_str(&format!(
            "\n## {chapter}\n\n| code | severity | what it means | what to do |\n|---|---|---|---|\n"
        ));
        for code in *codes {
            let (name, severity) = (code.name(), code.severity().name());
            let (title, meaning, remedy) = (code.title(), code.meaning(), code.remedy());
            page.push_str(&format!("| `{name}` | {severity} | {title} {meaning} | {remedy} |\n"));
        }
    }
    page
}
