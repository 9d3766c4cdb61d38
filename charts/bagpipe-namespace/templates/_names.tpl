{{- define "bagpipe.namespaceLabels" -}}
app.kubernetes.io/name: bagpipe-namespace
app.kubernetes.io/instance: {{ .Release.Name }}
app.kubernetes.io/version: {{ .Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .Release.Service }}
app.kubernetes.io/part-of: bagpipe
helm.sh/chart: {{ .Chart.Name }}-{{ .Chart.Version }}
{{- end }}
