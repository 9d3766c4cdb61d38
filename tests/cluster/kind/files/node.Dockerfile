# A node of kind's, of Debian's packages and the project's own build of Kubernetes.
ARG BASE
FROM ${BASE}
RUN systemctl mask getty.target console-getty.service systemd-logind.service systemd-udevd.service \
      systemd-remount-fs.service systemd-networkd.service systemd-networkd.socket \
      systemd-networkd-wait-online.service systemd-resolved.service systemd-timesyncd.service \
      systemd-firstboot.service dev-hugepages.mount sys-kernel-debug.mount sys-kernel-tracing.mount \
      sys-kernel-config.mount sys-fs-fuse-connections.mount systemd-modules-load.service \
      systemd-sysctl.service timers.target cni-dhcp.service cni-dhcp.socket && \
    systemctl set-default multi-user.target && rm -f /etc/machine-id
COPY kubernetes /usr/bin/kubelet
COPY kubeadm /usr/bin/kubeadm
COPY entrypoint cgroups /kind/
COPY default-cni.yaml default-storage.yaml /kind/manifests/
COPY kubelet.service /etc/systemd/system/
COPY containerd.conf /etc/systemd/system/containerd.service.d/images.conf
COPY containerd.toml /etc/containerd/config.toml
COPY pods.conflist /etc/cni/net.d/10-pods.conflist
COPY version images.tar /kind/
RUN ln -s kubelet /usr/bin/kubectl && systemctl enable kubelet.service containerd.service && \
    mkdir -p -m 777 /var/claims/0 /var/claims/1 /var/claims/2 /var/claims/3
STOPSIGNAL SIGRTMIN+3
ENV container=docker
ENTRYPOINT ["/kind/entrypoint", "/sbin/init"]
