#!/usr/bin/env python3
"""Prints the table of docs/benchmark.md from the results of .ci/benchmark.

usage: benchmark_table.py RESULTS BENCHMARK_README PROFILE THREADS
"""
import json
import re
import sys
from pathlib import Path


def peer(readme):
    """The rows of the peer's table by name: success reset, online, mm, deg, CPU ms."""
    rows = {}
    for line in Path(readme).read_text().splitlines():
        cells = [c.strip().strip('*') for c in line.strip().strip('|').split('|')]
        if len(cells) == 6 and all(re.fullmatch(r'[\d.]+', c) for c in cells[1:]):
            rows[cells[0]] = [float(c) for c in cells[1:]]
    return rows


def main():
    out, readme, profile, threads = Path(sys.argv[1]), sys.argv[2], sys.argv[3], sys.argv[4]
    scores = {p: json.loads((out / p / 'scores.json').read_text()) for p in ('reset', 'online')}
    table = json.loads((out / 'reset' / 'table.json').read_text())
    cpu = {r['sequence']: r['cpu_ms'] for r in table['sequences']}
    rows = {}
    for name, reset in scores['reset']['sequences'].items():
        online = scores['online']['sequences'][name]
        rows[name] = [reset['success_percent'], online['success_percent'], reset['median_mm'], reset['median_deg'], cpu[name]]
    groups = {}
    for name in rows:
        for group in dict.fromkeys((name.split('_')[0], name.rsplit('_', 1)[-1], 'all')):
            groups.setdefault(group, []).append(name)

    def mean(names, of):
        columns = zip(*(of[n] for n in names if n in of))
        return [sum(v for v in c if v is not None) / max(1, sum(v is not None for v in c)) for c in columns]

    def cell(value, digits):
        return '–' if value is None else f'{value:.{digits}f}'

    peers = peer(readme)
    yardstick = dict(re.findall(r'(\w+) ([\d.]+) ms', (out / 'yardstick.txt').read_text()))
    print(f"Profile `{profile}`, {threads} thread(s). Yardstick beside this run: blur {yardstick['blur']} ms, "
          f"decode {yardstick['decode']} ms. Ours / M3T.\n")
    print('| sequence | success, reset % | success, online % | median mm | median deg | CPU ms |')
    print('|---|---|---|---|---|---|')
    digits = (1, 1, 2, 2, 2)

    def line(name, ours, theirs):
        theirs = theirs or [None] * 5
        print(f'| {name} | ' + ' | '.join(f'{cell(a, d)} / {cell(b, d)}' for a, b, d in zip(ours, theirs, digits)) + ' |')

    for name, row in rows.items():
        line(name, row, peers.get(name))
    for group, names in sorted(groups.items(), key=lambda g: (g[0] == 'all', g[0])):
        line(f'**mean {group}**', mean(names, rows), mean(names, peers) or None)
    blur = float(yardstick['blur'])
    print(f"\nMean CPU time in blurs: {mean(groups['all'], rows)[4] / blur:.1f}; M3T in blurs of its own machine: 1.7.")


if __name__ == '__main__':
    main()
