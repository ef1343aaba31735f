# auvbench for CPUs. It has never been built: no container engine was at hand. `make release` tests the same installation in
# a fresh virtual environment.
#
#   docker build -t auvbench --build-arg TORCH_INDEX=URL .
#   docker run --rm -v "$PWD:/study" --user "$(id -u):$(id -g)" auvbench train -m algo=pid,ppo seed=0,1,2
#
# URL is PyTorch's index of CPU builds, which its page "Get started" names (Linux, pip, CPU). Without it pip takes the build
# for CUDA: it runs on CPUs too and is some 4 GB larger. Runs lie in ./outputs and belong to the user that --user names.

# Python 3.11.15 on Debian 13; the digest is that of all platforms.
ARG PYTHON=python:3.11-slim@sha256:90744cff8f32887f075c47d747a173ff333e9e98801667af93c357fa9f5e28ff

FROM ${PYTHON} AS build
WORKDIR /source
COPY . .
ARG TORCH_INDEX
# As `make install` does: all but PyTorch by the hashes of its files; then PyTorch and auvbench, whose needs are there.
RUN python -m venv /opt/auvbench \
    && /opt/auvbench/bin/pip install --no-cache-dir --require-hashes --no-deps -r requirements-build.lock \
    && /opt/auvbench/bin/pip install --no-cache-dir --require-hashes --no-deps --no-build-isolation -r requirements.lock \
    && /opt/auvbench/bin/pip install --no-cache-dir ${TORCH_INDEX:+--index-url "$TORCH_INDEX"} "$(grep ^torch== constraints.txt)" \
    && /opt/auvbench/bin/pip install --no-cache-dir --no-build-isolation -c constraints.txt '.[mpc]'
# The first step compiles the simulator: done here, no container has to, unless its processor is another one. Any user may
# then write there.
WORKDIR /
RUN NUMBA_CACHE_DIR=/opt/numba /opt/auvbench/bin/python -c \
    'import auvbench, gymnasium; e = gymnasium.make("auvbench/Waypoint-v1"); e.reset(); e.step(e.action_space.sample())' \
    && chmod -R a+rwX /opt/numba

FROM ${PYTHON}
COPY --from=build /opt/auvbench /opt/auvbench
COPY --from=build /opt/numba /opt/numba
# Folders that any user may write: --user names one that the image does not know.
ENV PATH=/opt/auvbench/bin:$PATH HOME=/tmp NUMBA_CACHE_DIR=/opt/numba MPLCONFIGDIR=/tmp/matplotlib OMP_NUM_THREADS=1
RUN useradd --uid 1000 auv && mkdir -m 1777 /study
USER auv
WORKDIR /study
ENTRYPOINT ["auvbench"]
CMD ["--help"]
