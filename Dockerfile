# auvbench for CPUs. It has never been built: no container engine was at hand. `make release` tests the same installation in
# a fresh virtual environment.
#
#   docker build -t auvbench --build-arg TORCH_INDEX=URL .
#   docker run --rm -v "$PWD:/study" --user "$(id -u):$(id -g)" auvbench train -m algo=pid,ppo seed=0,1,2
#
# URL is PyTorch's index of CPU builds, which its page "Get started" names (Linux, pip, CPU). Without it pip takes the build
# for CUDA: it runs on CPUs too and is some 4 GB larger. Runs lie in ./outputs and belong to the user that --user names.
FROM python:3.11-slim AS build
WORKDIR /source
COPY . .
ARG TORCH_INDEX
RUN python -m venv /opt/auvbench \
    && /opt/auvbench/bin/pip install --no-cache-dir ${TORCH_INDEX:+--index-url "$TORCH_INDEX"} "$(grep ^torch== constraints.txt)" \
    && /opt/auvbench/bin/pip install --no-cache-dir -c constraints.txt '.[mpc]'

FROM python:3.11-slim
COPY --from=build /opt/auvbench /opt/auvbench
# Folders that any user may write: --user names one that the image does not know.
ENV PATH=/opt/auvbench/bin:$PATH HOME=/tmp NUMBA_CACHE_DIR=/tmp/numba MPLCONFIGDIR=/tmp/matplotlib OMP_NUM_THREADS=1
RUN useradd --uid 1000 auv && mkdir -m 1777 /study
USER auv
WORKDIR /study
ENTRYPOINT ["auvbench"]
CMD ["--help"]
