# All that runs in the pods of a control plane, under the names that kubeadm calls.
ARG BASE
FROM ${BASE} AS tools
RUN mkdir /out && set -eu && for name in xtables-nft-multi xtables-legacy-multi conntrack; do \
      path=$(command -v $name) && cp --parents -L $path /out && \
      ldd $path | grep -o '/[^ ]*' | xargs -I{} cp --parents -L {} /out; done && \
    cp -r --parents /usr/lib/x86_64-linux-gnu/xtables /out && \
    for name in iptables ip6tables; do for verb in "" -save -restore; do \
      ln -s xtables-nft-multi /out/usr/sbin/$name$verb; done; done && \
    mkdir -p /out/tmp /out/run

FROM scratch
COPY --from=tools /out /
COPY kubernetes /usr/local/bin/kube-apiserver
COPY links /usr/local/bin/
COPY resolver /coredns
COPY pause /pause
ENV PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
ENTRYPOINT ["/coredns"]
