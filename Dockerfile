# The program and the module of Python, with Mesa's software Vulkan: docs/install.md.
#     docker build --tag quadrille .
#     docker run --rm -v "$PWD:/data" quadrille correlate --output out 'images/*.tif'
FROM rust:1.95-bookworm AS build
RUN apt-get update && apt-get install --yes --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /venv && /venv/bin/pip install --no-cache-dir 'maturin>=1.9,<2'
WORKDIR /source
COPY . .
RUN cd python && /venv/bin/maturin build --release --locked --compatibility linux --out /wheels

FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3 python3-venv libvulkan1 mesa-vulkan-drivers \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheels /wheels
RUN python3 -m venv /opt/quadrille && /opt/quadrille/bin/pip install --no-cache-dir /wheels/*.whl && rm -r /wheels
ENV PATH=/opt/quadrille/bin:$PATH
WORKDIR /data
ENTRYPOINT ["quadrille"]
CMD ["--help"]
