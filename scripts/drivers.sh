#!/usr/bin/env bash
# The shaders on other ground: on SwiftShader, the driver of the browser Chromium (another compiler, another machine model), and under the
# validation layer of Khronos, which names every access to a buffer that nothing keeps in order. Both come with Debian packages
# (scripts/prepare.sh --chromium, --validation); what is not there is said and left out.
#
#     scripts/drivers.sh [--long] [words for cargo test]
#
# --long: whole frames as well, not the kernels alone; and every shader translated for Metal and OpenGL by the program naga, which is installed
# into target/naga.
set -euo pipefail
cd "$(dirname "$0")/.."

long=no
quick=(gpu_kernels:: a_series_on_the_gpu when_the_fresh_device a_device_that_computes devices_lists)
kernels=(gpu_kernels::)
if [ "${1:-}" = --long ]; then
    shift
    long=yes
    quick+=(gpu_frames::)
    kernels+=(gpu_frames::)
fi
export QUADRILLE_GPU=require
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# The driver looks for a folder of its own, and complains without one.
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-$folder}

if [ "$long" = yes ]; then
    version=$(cargo pkgid --locked naga)
    [ -x target/naga/bin/naga ] || cargo install naga-cli --version "${version##*@}" --locked --root target/naga
    QUADRILLE_NAGA="$PWD/target/naga/bin/naga" cargo test --locked "$@" --test correlation -- shaders::
fi

swiftshader=/usr/lib/chromium/vk_swiftshader_icd.json
if [ -e "$swiftshader" ]; then
    VK_DRIVER_FILES="$swiftshader" cargo test --locked "$@" --test correlation --test devices -- "${quick[@]}"
else
    echo "drivers: no SwiftShader (Debian's package chromium)"
fi

if [ -e /usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json ]; then
    log=$folder/validation.txt
    # Its remarks are kept as well: the first one says that the layer is at work, and that accesses are followed.
    cat > "$folder/vk_layer_settings.txt" <<SETTINGS
khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG
khronos_validation.report_flags = error,warn,info
khronos_validation.log_filename = $log
khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT
SETTINGS
    VK_LAYER_SETTINGS_PATH="$folder" VK_INSTANCE_LAYERS=VK_LAYER_KHRONOS_validation \
        cargo test --locked "$@" --test correlation -- "${kernels[@]}"
    grep -q 'Current Enables:.*SYNCHRONIZATION_VALIDATION' "$log" || { echo "drivers: the validation layer did not work"; exit 1; }
    if grep -E '\((ERROR|WARN)' "$log"; then
        echo "drivers: the validation layer has found faults, see above"
        exit 1
    fi
    echo "drivers: the validation layer has found nothing"
else
    echo "drivers: no validation layer (Debian's package vulkan-validationlayers)"
fi
