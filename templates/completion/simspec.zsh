#compdef simspec
# Completion of simspec for zsh. In ~/.zshrc, after compinit: eval "$(simspec completion zsh)"
_simspec() {
  local kind word help suffix
  local -a plain starts suffixes
  while IFS=$'\t' read -r kind word help; do
    case $kind in
      word) plain+=("${word//:/\\:}${help:+:$help}") ;;
      start) starts+=("$word") ;;
      files)
        [[ $PREFIX == --*=* ]] && compset -P '*='
        suffixes=(${(s: :)word})
        if [[ -n $suffixes ]]; then _files -g "*(${(j:|:)suffixes})"; else _files; fi ;;
      folders)
        [[ $PREFIX == --*=* ]] && compset -P '*='
        _files -/ ;;
    esac
  done < <(_SIMSPEC_COMPLETE=zsh "${words[1]}" "${(@Q)words[2,CURRENT-1]}" "${(Q)PREFIX}" 2>/dev/null)
  (( $#plain )) && _describe -t words word plain
  (( $#starts )) && compadd -S '' -a starts
  return 0
}
compdef _simspec simspec
