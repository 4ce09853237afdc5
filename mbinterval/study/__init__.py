"""What accuracy costs in time: sweeps against references, their report, and recommendations.

    sweeps, costs ─▶ run ─▶ study.json, study.csv, films ─▶ report ─▶ report.html

``reference`` makes what rows are judged by, ``judge`` their errors, ``summary`` what follows.
"""
