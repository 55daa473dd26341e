# The base image is pinned by digest (3.12.14, all platforms): docker buildx imagetools inspect python:3.12-slim-bookworm
# The programs, and `metric-tree serve`: docker build -t metric-tree . && docker run --rm -p 8000:8000 metric-tree
#   docker run --rm -v "$PWD:/work" metric-tree estimate-scale /work/scene
FROM python:3.12-slim-bookworm@sha256:782412e85d0f0984994c290652577d4018aff08145c85b262bb63dc0c7522254 AS build
WORKDIR /source
COPY . .
# versions and checksums of the lock, nothing else
RUN python -m venv /opt/metric-tree \
    && /opt/metric-tree/bin/pip install --no-cache-dir --require-hashes -r .ci/uv.lock.txt \
    && /opt/metric-tree/bin/uv pip install --no-cache --python /opt/metric-tree/bin/python \
       --constraint requirements.lock --build-constraints .ci/build.lock.txt '.[scene,serve,mcp]'

FROM python:3.12-slim-bookworm@sha256:782412e85d0f0984994c290652577d4018aff08145c85b262bb63dc0c7522254
COPY --from=build /opt/metric-tree /opt/metric-tree
ENV PATH=/opt/metric-tree/bin:$PATH PYTHONDONTWRITEBYTECODE=1
# nobody's account: the programs write only where a folder is mounted
RUN useradd --create-home --uid 10001 metric
USER 10001
WORKDIR /home/metric
# the tables of the pages, so that the server starts without making them
RUN metric-tree serve --prepare
EXPOSE 8000
HEALTHCHECK --start-period=20s CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:8000/healthz', timeout=3)"]
CMD ["metric-tree", "serve", "--host", "0.0.0.0"]
