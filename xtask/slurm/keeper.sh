# Outlives `cargo xtask slurm`: reads the daemons' process numbers, and when its input closes, however that program
# ended, ends the jobs and then the daemons.
while read -r pid; do pids="$pid $pids"; done
if [ "$(echo $pids | wc -w)" = 3 ]; then
    scancel --partition=walk
    for _ in $(seq 100); do [ -z "$(squeue --noheader)" ] && break; sleep 0.2; done
fi
kill -TERM $pids
