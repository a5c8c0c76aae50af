# The server with its tools. Build: docker build -t depthtween .   (or buildah bud, podman build)
#
#   docker run -p 127.0.0.1:50051:50051 -v depthtween:/var/lib/depthtween --read-only --init depthtween
#
# There is no TLS and there are no tokens yet: publish the port on the loopback interface, as above, or to a private
# network only.
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS build
COPY deploy/install-packages.sh deploy/apt-packages.txt /source/deploy/
RUN /source/deploy/install-packages.sh build
COPY . /source
WORKDIR /source
# The processor to compile for; the default is every x86-64 with AVX2 (since 2013).
ARG DEPTHTWEEN_CPU=x86-64-v3
RUN cmake --preset release -DDEPTHTWEEN_CPU="${DEPTHTWEEN_CPU}" \
 && cmake --build --preset release --target depthtween-server depthtween-core depthtween -- --quiet \
 && strip build/release/bin/depthtween*

FROM ${BASE}
ARG VERSION=0.1.0
LABEL org.opencontainers.image.title="Depthtween" \
      org.opencontainers.image.description="Gives depth video the frame rate of colour video: server and tools" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.licenses="Apache-2.0"
COPY deploy/install-packages.sh deploy/apt-packages.txt /usr/share/doc/depthtween/
RUN /usr/share/doc/depthtween/install-packages.sh runtime \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --system --uid 10001 --user-group --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin \
      depthtween \
 && install --directory --owner=depthtween --group=depthtween --mode=0750 /var/lib/depthtween
COPY --from=build /source/build/release/bin/depthtween-server /source/build/release/bin/depthtween-core \
     /source/build/release/bin/depthtween /usr/local/bin/
COPY LICENSE deploy/licences.md /usr/share/doc/depthtween/

USER 10001:10001
# Nothing else is written to, so the root file system may be read-only.
VOLUME /var/lib/depthtween
EXPOSE 50051
STOPSIGNAL SIGTERM
# buildah and podman keep this line only with --format docker.
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s CMD ["depthtween-server", "healthcheck"]
ENTRYPOINT ["depthtween-server"]
# A container's loopback interface cannot be reached from outside, so the server listens on all its interfaces.
CMD ["serve", "--data-dir", "/var/lib/depthtween", \
     "--listen", "0.0.0.0:50051", "--insecure-listen-anywhere", "--log-json"]
