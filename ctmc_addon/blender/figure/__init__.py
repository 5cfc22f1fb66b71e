"""Figures for print: pages, sheets, distance maps and turntables of surfaces."""
