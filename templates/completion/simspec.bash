# Completion of simspec for bash. In ~/.bashrc: eval "$(simspec completion bash)"
_simspec() {
  local kind word help suffix name
  COMPREPLY=()
  while IFS=$'\t' read -r kind word help; do
    case $kind in
      word) COMPREPLY+=("$word") ;;
      start) COMPREPLY+=("$word"); compopt -o nospace 2>/dev/null ;;
      files)
        compopt -o filenames 2>/dev/null
        for suffix in ${word:-""}; do
          while IFS= read -r name; do COMPREPLY+=("$name"); done < <(compgen -f -X "!*$suffix" -- "$2")
        done
        while IFS= read -r name; do COMPREPLY+=("$name"); done < <(compgen -d -- "$2") ;;
      folders)
        compopt -o filenames 2>/dev/null
        while IFS= read -r name; do COMPREPLY+=("$name"); done < <(compgen -d -- "$2") ;;
    esac
  done < <(_SIMSPEC_COMPLETE=bash "$1" "${COMP_LINE:0:COMP_POINT}" "$2" 2>/dev/null)
}
complete -F _simspec simspec
