# Completion of simspec for fish. In ~/.config/fish/config.fish: simspec completion fish | source
function __simspec_complete
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    set -l option (string match -r -- '^--[^=]*=' "$current")
    set -l path (string replace -r -- '^--[^=]*=' '' "$current")
    set -l program $words[1]
    set -e words[1]
    env _SIMSPEC_COMPLETE=fish $program $words "$current" 2>/dev/null | while read -l -d \t kind word help
        switch $kind
            case word start
                printf '%s\t%s\n' $word $help
            case files
                for name in (__fish_complete_path "$path" | string split -f 1 \t)
                    for suffix in / (string split ' ' -- "$word")
                        string match -q -- "*$suffix" $name; and printf '%s%s\n' "$option" $name; and break
                    end
                end
            case folders
                for name in (__fish_complete_directories "$path" | string split -f 1 \t)
                    printf '%s%s\n' "$option" $name
                end
        end
    end
end
complete -c simspec -f -a '(__simspec_complete)'
