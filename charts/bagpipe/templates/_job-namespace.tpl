{{- /* What a namespace of jobs has. The chart bagpipe-namespace links to this file, so that rights are defined once. */ -}}

{{/* What Spark's driver does with the API server in client mode: it creates executors, lists and
     watches them, deletes single ones by name and, when it stops, all of its own by label
     (deletecollection). It reads its own pod to become the executors' owner. ConfigMaps,
     Services and PersistentVolumeClaims are not needed as Bagpipe configures Spark.
     Executors have an account without rights and without a token; a cloud's identity for
     storage is given to both accounts by annotations. The driver's pod mounts its token itself, into
     one container; no other pod that uses the account gets it without asking.
     Where drivers wait for further jobs, each looks up whether a job that it is offered claims it.
     Takes the namespace, the labels as text, and the values serviceAccounts and pools. */}}
{{- define "bagpipe.jobAccounts" -}}
{{- range $role := list "driver" "executor" }}
apiVersion: v1
kind: ServiceAccount
metadata:
  name: bagpipe-{{ $role }}
  namespace: {{ $.namespace }}
  labels:
    {{- $.labels | nindent 4 }}
  {{- with (get $.accounts $role).annotations }}
  annotations:
    {{- toYaml . | nindent 4 }}
  {{- end }}
automountServiceAccountToken: false
{{- with $.accounts.imagePullSecrets }}
imagePullSecrets:
  {{- toYaml . | nindent 2 }}
{{- end }}
---
{{- end }}
apiVersion: rbac.authorization.k8s.io/v1
kind: Role
metadata:
  name: bagpipe-driver
  namespace: {{ .namespace }}
  labels:
    {{- .labels | nindent 4 }}
rules:
- apiGroups: [""]
  resources: [pods]
  verbs: [get, list, watch, create, delete, deletecollection]
{{- if .pools.enabled }}
- apiGroups: [sim.bagpipe.io]
  resources: [simulationjobs]
  verbs: [get]
{{- end }}
---
apiVersion: rbac.authorization.k8s.io/v1
kind: RoleBinding
metadata:
  name: bagpipe-driver
  namespace: {{ .namespace }}
  labels:
    {{- .labels | nindent 4 }}
roleRef:
  apiGroup: rbac.authorization.k8s.io
  kind: Role
  name: bagpipe-driver
subjects:
- kind: ServiceAccount
  name: bagpipe-driver
  namespace: {{ .namespace }}
---
{{- end }}

{{/* Who may open a connection to what. Drivers and executors of a namespace speak Spark with each
     other on ports that Spark chooses; the operator asks drivers for their progress, and who is
     named in metricsFrom reads metrics, of executors those of each image's agent. Nobody else has
     any business with them. Outgoing connections stay free: the stack shares its executor's
     network, and that has to reach storage wherever it is, and the API server.
     Takes the namespace, the labels as text, metricsFrom, and of the operator its namespace (home)
     and its pods' labels as text (selector). */}}
{{- define "bagpipe.jobPolicies" -}}
{{- range $role := list "driver" "executor" }}
apiVersion: networking.k8s.io/v1
kind: NetworkPolicy
metadata:
  name: bagpipe-{{ $role }}
  namespace: {{ $.namespace }}
  labels:
    {{- $.labels | nindent 4 }}
spec:
  podSelector:
    matchLabels:
      app.kubernetes.io/managed-by: bagpipe
      sim.bagpipe.io/role: {{ $role }}
  policyTypes: [Ingress]
  ingress:
  - from:
    - podSelector:
        matchLabels:
          app.kubernetes.io/managed-by: bagpipe
          sim.bagpipe.io/role: executor
    {{- if eq $role "executor" }}
    - podSelector:
        matchLabels:
          app.kubernetes.io/managed-by: bagpipe
          sim.bagpipe.io/role: driver
  {{- with $.metricsFrom }}
  - from:
    {{- toYaml . | nindent 4 }}
    ports:
    - {port: 9811, endPort: 9826, protocol: TCP}
  {{- end }}
    {{- else }}
  - from:
    - namespaceSelector:
        matchLabels:
          kubernetes.io/metadata.name: {{ $.home }}
      podSelector:
        matchLabels:
          {{- $.selector | nindent 10 }}
    {{- with $.metricsFrom }}
    {{- toYaml . | nindent 4 }}
    {{- end }}
    ports:
    - {port: 8080, protocol: TCP}
    {{- end }}
---
{{- end }}
{{- end }}
