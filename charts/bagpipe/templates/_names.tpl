{{/* The name of everything in the release's namespace. */}}
{{- define "bagpipe.name" -}}
{{- $base := ternary .Release.Name (printf "%s-bagpipe" .Release.Name) (contains "bagpipe" .Release.Name) -}}
{{- trunc 50 $base | trimSuffix "-" }}-operator
{{- end }}

{{/* The name of cluster-wide objects and of objects in other namespaces: two releases must not meet. */}}
{{- define "bagpipe.globalName" -}}
{{ printf "%s-%s" .Release.Namespace (include "bagpipe.name" .) | trunc 63 | trimSuffix "-" }}
{{- end }}

{{- define "bagpipe.selector" -}}
app.kubernetes.io/name: bagpipe-operator
app.kubernetes.io/instance: {{ .Release.Name }}
{{- end }}

{{- define "bagpipe.labels" -}}
{{ include "bagpipe.selector" . }}
app.kubernetes.io/version: {{ .Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .Release.Service }}
app.kubernetes.io/part-of: bagpipe
helm.sh/chart: {{ .Chart.Name }}-{{ .Chart.Version }}
{{- end }}

{{/* An image's full name; takes a list of the root and the image's key in values.images. A digest says
     which image it is, and a tag beside it would say nothing more. */}}
{{- define "bagpipe.image" -}}
{{- $root := index . 0 -}}
{{- $key := index . 1 -}}
{{- $images := $root.Values.images -}}
{{- $name := printf "%s/%s" $images.registry (get $images $key) -}}
{{- with get $images.digests $key -}}
{{ $name }}@{{ . }}
{{- else -}}
{{ $name }}:{{ get $images.tags $key | default $images.tag | default $root.Chart.AppVersion }}
{{- end }}
{{- end }}

{{/* The labels of the nodes for what runs the operator's image, as YAML: the images' processor, and what
     the administrator asks for, whose own word of the processor counts. */}}
{{- define "bagpipe.nodes" -}}
{{- $labels := deepCopy .Values.operator.nodeSelector -}}
{{- with .Values.images.architecture -}}
{{- $labels = merge $labels (dict "kubernetes.io/arch" .) -}}
{{- end -}}
{{- toYaml $labels -}}
{{- end }}

{{/* The namespaces that the operator watches, with commas; none of them means all, which has to be
     stated: an empty list must never come to the whole cluster by itself. */}}
{{- define "bagpipe.watched" -}}
{{- $named := .Values.watchNamespaces | default .Values.jobNamespaces -}}
{{- if and .Values.clusterWide .Values.watchNamespaces }}
{{- fail "watchNamespaces has names and clusterWide is true: leave one of them out" }}
{{- else if not (or .Values.clusterWide $named) }}
{{- fail "the operator has nothing to watch: name namespaces in jobNamespaces or watchNamespaces, or set clusterWide: true" }}
{{- end }}
{{- if not .Values.clusterWide }}{{ join "," $named }}{{ end }}
{{- end }}

{{/* What the operator may do, and nothing else. */}}
{{- define "bagpipe.rules" -}}
- apiGroups: [sim.bagpipe.io]
  resources: [simulationjobs]
  verbs: [get, list, watch]
- apiGroups: [sim.bagpipe.io]
  resources: [simulationjobs/status]
  verbs: [patch]
# A schedule makes its jobs, and deletes those beyond its history or that it replaces; the sweeper
# deletes those that were kept for long enough after their end.
- apiGroups: [sim.bagpipe.io]
  resources: [simulationjobs]
  verbs: [create, delete]
- apiGroups: [sim.bagpipe.io]
  resources: [simulationschedules]
  verbs: [get, list, watch]
- apiGroups: [sim.bagpipe.io]
  resources: [simulationschedules/status]
  verbs: [patch]
- apiGroups: [""]
  resources: [pods]
  verbs: [get, list, watch, create, delete]
- apiGroups: [""]
  resources: [configmaps]
  verbs: [get, create]
- apiGroups: [""]
  resources: [events]
  verbs: [create, list]
- apiGroups: [""]
  resources: [persistentvolumeclaims]
  verbs: [get]
{{- if .Values.kueue.enabled }}
- apiGroups: [kueue.x-k8s.io]
  resources: [workloads]
  verbs: [get, list, watch, create, delete]
- apiGroups: [kueue.x-k8s.io]
  resources: [workloads/status]
  verbs: [patch]
{{- end }}
{{- end }}

{{/* Whether a cluster-wide object with a name of its own is this release's to make: it is not there,
     or this release has made it. Takes a list of the root, API version, kind and name. Without a
     cluster (helm template) nothing is there. */}}
{{- define "bagpipe.isOurs" -}}
{{- $root := index . 0 -}}
{{- $found := lookup (index . 1) (index . 2) "" (index . 3) -}}
{{- $notes := dig "metadata" "annotations" dict ($found | default dict) -}}
{{- $mine := and (eq (get $notes "meta.helm.sh/release-name") $root.Release.Name) (eq (get $notes "meta.helm.sh/release-namespace") $root.Release.Namespace) -}}
{{- if or (not $found) $mine }}yes{{ else }}no{{ end }}
{{- end }}

{{/* Whether this release has a CRD: the values want it, and nobody else has put it there. Takes a
     list of the root and the kind's plural. The CRD is a template and not in the folder crds/, which Helm never upgrades; and it outlives its
     release, so a later release must live with it instead of failing. */}}
{{- define "bagpipe.ownsCrd" -}}
{{- $root := index . 0 -}}
{{- $name := printf "%s.sim.bagpipe.io" (index . 1) -}}
{{- $ours := include "bagpipe.isOurs" (list $root "apiextensions.k8s.io/v1" "CustomResourceDefinition" $name) -}}
{{- if and $root.Values.crds.install (eq $ours "yes") }}yes{{ else }}no{{ end }}
{{- end }}

{{/* What makes an account or a right exist for `helm test` only, and before its pod. */}}
{{- define "bagpipe.testRights" -}}
helm.sh/hook: test
helm.sh/hook-weight: "-1"
helm.sh/hook-delete-policy: before-hook-creation,hook-succeeded
{{- end }}

{{/* The receivers of notifications as the operator reads them: without their Secrets, which are mounted. */}}
{{- define "bagpipe.receivers" -}}
{{- $names := list }}
{{- $receivers := list }}
{{- range .Values.notifications.receivers }}
{{- if has .name $names }}
{{- fail (printf "notifications.receivers has two called %s: give each a name of its own" .name) }}
{{- end }}
{{- $names = append $names .name }}
{{- $receivers = append $receivers (omit . "secretName") }}
{{- end }}
{{- $receivers | toJson }}
{{- end }}
