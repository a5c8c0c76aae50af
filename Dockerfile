# The server with its tools. Build: docker build -t depthtween .   (or buildah bud, podman build)
#
# As it is, it speaks TLS and asks for tokens. In certs/: cert.pem and key.pem (its certificate, which also names
# localhost, for the health check), ca.pem (who signed it), tokens.json; all readable by user 10001, who owns the last:
#
#   docker run --rm -v ./certs:/etc/depthtween --user 0 --entrypoint sh depthtween -c 'depthtween-server token new \
#     --tokens /etc/depthtween/tokens.json --tenant studio --scopes read,write && chown -R 10001 /etc/depthtween'
#   docker run -p 50051:50051 -p 8443:8443 -v ./certs:/etc/depthtween:ro -v depthtween:/var/lib/depthtween --read-only \
#     --init depthtween
#
# Let strangers reach it only through nginx (deploy/nginx, deploy/OPERATING.md). Without TLS and tokens everybody who
# reaches the port can read and delete everything; that is for this machine alone, or your own network of containers:
#
#   docker run -p 127.0.0.1:50051:50051 -v depthtween:/var/lib/depthtween --read-only --init \
#     --health-cmd 'depthtween-server healthcheck' depthtween \
#     serve --data-dir /var/lib/depthtween --listen 0.0.0.0:50051 --insecure-listen-anywhere --log-json
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
EXPOSE 50051 8443
STOPSIGNAL SIGTERM
# buildah and podman keep this line only with --format docker.
HEALTHCHECK --interval=10s --timeout=5s --start-period=10s \
  CMD ["depthtween-server", "healthcheck", "--server", "localhost:50051", "--tls-ca", "/etc/depthtween/ca.pem"]
ENTRYPOINT ["depthtween-server"]
# A container's loopback interface cannot be reached from outside, so the server listens on all its interfaces.
CMD ["serve", "--data-dir", "/var/lib/depthtween", "--listen", "0.0.0.0:50051", "--http-listen", "0.0.0.0:8443", \
     "--tls-cert", "/etc/depthtween/cert.pem", "--tls-key", "/etc/depthtween/key.pem", \
     "--tokens", "/etc/depthtween/tokens.json", "--log-json"]
